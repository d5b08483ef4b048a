//! Networks of the published systems as they are played and stored.

use glam::{DMat3, DVec3};
use muslin_body::{Avatar, Figure, Motion, Pose, Shape, motions};
use muslin_model::{Encoder, Model, Ncs, Player, Resizer, Skin, Snug, Trait};
use muslin_net::Numbers;
use muslin_net::learn::{Gru, Mlp, Noise, Nonlinear};

const DRIVERS: [&str; 3] = ["root", "spine03", "upperarm01.L"];
const CODES: usize = 5;
const STEP: f64 = 1.0 / 30.0;

struct Stage {
    avatar: Avatar,
    figure: Figure,
    motion: Motion,
}

impl Stage {
    fn new() -> Self {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let motion = motions::make(&avatar, &figure, "dance", 30.0).expect("a built-in motion");
        Self {
            avatar,
            figure,
            motion,
        }
    }

    fn joints(&self) -> Vec<DVec3> {
        let joint = |b: &&str| self.figure.joints[self.avatar.bone(b).expect("a bone")];
        DRIVERS.iter().map(joint).collect()
    }

    fn encoders(&self) -> [Encoder; 3] {
        let mlp = |widths: &[usize], bias: bool| Mlp {
            widths: widths.to_vec(),
            bend: Nonlinear::Relu,
            bias,
        };
        [
            Encoder::Pbns(mlp(&[9, 8, CODES], true)),
            Encoder::Snug(Snug {
                body: vec![0.3, -0.2],
                widths: vec![14, 6, CODES],
            }),
            Encoder::Ncs(Ncs {
                joints: (self.joints().iter())
                    .map(|p| p.as_vec3().to_array())
                    .collect(),
                still: mlp(&[21, 7, 6], true),
                joint: mlp(&[12, 4, 4], false),
                whole: mlp(&[12, 8, 8], false),
                decoder: mlp(&[6, 9, CODES], true),
            }),
        ]
    }

    /// One vertex on one bone, whose rest place is moved by the codes themselves.
    fn model(&self, encoder: Encoder) -> Model {
        let mut noise = Noise::new(4);
        let n = 2;
        let params = noise.normals(encoder.n_params());
        let inputs = encoder.n_inputs(DRIVERS.len());
        let mut modes = vec![0.0; 3 * n * (CODES + 1)];
        (0..CODES).for_each(|c| modes[c * (CODES + 1) + c] = 1.0);
        Model {
            notes: Default::default(),
            faces: Vec::new(),
            template: vec![[0.0; 3]; n],
            bones: vec!["root".to_owned()],
            skin: Skin {
                starts: vec![0, 1, 2],
                bones: vec![0; n],
                weights: vec![1.0; n],
            },
            drivers: DRIVERS.map(str::to_owned).to_vec(),
            scale: vec![[0.0, 1.0]; inputs],
            params: params.iter().map(|p| 0.5 * p).collect(),
            encoder,
            modes,
            traits: Vec::new(),
            sway: None,
            resizer: None,
        }
    }

    /// The codes of every pose, read off the vertices.
    fn play(&self, player: &mut Player, poses: &[Pose]) -> Vec<Vec<f64>> {
        let one = |pose: &Pose| {
            let bones = self.avatar.bones(&self.figure, pose);
            let mut out = vec![[0.0f32; 3]; 2];
            player.frame(pose, &bones, &mut out);
            let root = bones[self.avatar.bone("root").expect("a bone")].inverse();
            let back = |p: &[f32; 3]| {
                root.transform_point3(DVec3::from_array(p.map(f64::from)))
                    .to_array()
            };
            out.iter().flat_map(back).take(CODES).collect()
        };
        poses.iter().map(one).collect()
    }

    fn player(&self, model: &Model) -> Player {
        let mut player = Player::new(model, &self.avatar).expect("the bones are there");
        player.begin(STEP);
        player
    }

    fn turns(&self, pose: &Pose) -> Vec<f64> {
        let turn = |(k, b): (usize, &&str)| {
            let q = pose.rotations[self.avatar.bone(b).expect("a bone")];
            let q = match k {
                // Swing and twist: what is left when the twist about the vertical is undone.
                0 => glam::DQuat::from_rotation_y(-2.0 * q.y.atan2(q.w)) * q,
                _ => q,
            };
            let (axis, angle) = q.to_axis_angle();
            let angle = if angle > std::f64::consts::PI {
                angle - std::f64::consts::TAU
            } else {
                angle
            };
            (axis * angle).to_array()
        };
        DRIVERS.iter().enumerate().flat_map(turn).collect()
    }

    /// Turns, gravity and place of every joint in a pose.
    fn joint(&self, pose: &Pose, j: usize) -> (DMat3, DMat3, DVec3, DVec3) {
        let b = self.avatar.bone(DRIVERS[j]).expect("a bone");
        let bone = self.avatar.bones(&self.figure, pose)[b];
        let own = DMat3::from_quat(pose.rotations[b]);
        let down = bone.matrix3.transpose() * DVec3::NEG_Y;
        let place = bone.transform_point3(self.joints()[j]);
        (own, bone.matrix3, down, place)
    }

    fn still(&self, pose: &Pose) -> Vec<f64> {
        let one = |j: usize| {
            let (own, _, down, _) = self.joint(pose, j);
            let turn = [own.x_axis, own.y_axis].map(|c| c.to_array()).concat();
            let turn = if j == 0 { Vec::new() } else { turn };
            [turn, down.to_array().to_vec()].concat()
        };
        (0..3).flat_map(one).collect()
    }

    fn moving(&self, [now, one, two]: [&Pose; 3]) -> Vec<f64> {
        let joint = |j: usize| {
            let (own, world, down, place) = self.joint(now, j);
            let (own1, world1, down1, place1) = self.joint(one, j);
            let place2 = self.joint(two, j).3;
            let change = match j {
                0 => world.transpose() * (world - world1),
                _ => own - own1,
            };
            let rate = [change.x_axis, change.y_axis, down - down1].map(|c| c / STEP);
            let force = world.transpose() * (place - 2.0 * place1 + place2) / (STEP * STEP);
            [rate[0], rate[1], rate[2], force].map(|c| c.to_array())
        };
        (0..3).flat_map(|j| joint(j).concat()).collect()
    }
}

fn dense(w: &[f32], x: &[f64], b: Option<&[f32]>) -> Vec<f64> {
    let row = |(k, row): (usize, &[f32])| {
        let dot: f64 = row.iter().zip(x).map(|(w, x)| f64::from(*w) * x).sum();
        dot + b.map_or(0.0, |b| f64::from(b[k]))
    };
    w.chunks(x.len()).enumerate().map(row).collect()
}

fn rectified(mlp: &Mlp, params: &mut &[f32], x: &[f64]) -> Vec<f64> {
    let mut x = x.to_vec();
    for l in mlp.layers() {
        let (own, rest) = params.split_at(l.n_params());
        *params = rest;
        let (w, b) = own.split_at(l.inputs * l.outputs);
        x = dense(w, &x, l.bias.then_some(b));
        x.iter_mut().for_each(|x| *x = x.max(0.0));
    }
    x
}

fn recur(gru: &Gru, params: &mut &[f32], x: &[f64], h: &mut [f64]) {
    let (own, rest) = params.split_at(gru.n_params());
    *params = rest;
    let n = gru.size;
    let (w, rest) = own.split_at(3 * n * gru.inputs);
    let (u, rest) = rest.split_at(3 * n * n);
    let (b, c) = rest.split_at(rest.len() / 2);
    let (outer, inner) = (
        dense(w, x, gru.bias.then_some(b)),
        dense(u, h, gru.bias.then_some(c)),
    );
    let gate = |k: usize| 1.0 / (1.0 + (-(outer[k] + inner[k])).exp());
    for i in 0..n {
        let new = (outer[2 * n + i] + gate(i) * inner[2 * n + i]).tanh();
        h[i] = (1.0 - gate(n + i)) * new + gate(n + i) * h[i];
    }
}

/// The network over a sequence in plain loops of double precision.
fn codes(stage: &Stage, model: &Model, poses: &[Pose]) -> Vec<Vec<f64>> {
    let at = |k: usize, back: usize| &poses[k.saturating_sub(back)];
    let mut states = vec![vec![0.0; 6], vec![0.0; CODES]];
    let one = |k: usize| {
        let mut params = model.params.as_slice();
        match &model.encoder {
            Encoder::Pbns(m) => rectified(m, &mut params, &stage.turns(&poses[k])),
            Encoder::Snug(s) => {
                let pose = &poses[k];
                let root = pose.rotations[0];
                let back = glam::DQuat::from_rotation_y(-2.0 * root.y.atan2(root.w));
                let speed = back * (pose.root - at(k, 1).root) / STEP;
                let mut x: Vec<f64> = s.body.iter().map(|x| f64::from(*x)).collect();
                x.extend(stage.turns(pose));
                x.extend(speed.to_array());
                for (gru, h) in s.layers().zip(&mut states) {
                    recur(&gru, &mut params, &x, h);
                    x = h.to_vec();
                }
                x
            }
            Encoder::Ncs(n) => {
                let still = rectified(&n.still, &mut params, &stage.still(&poses[k]));
                let told = stage.moving([at(k, 0), at(k, 1), at(k, 2)]);
                let shared = params;
                let joints = told.chunks(12).flat_map(|x| {
                    params = shared;
                    rectified(&n.joint, &mut params, x)
                });
                let joints: Vec<f64> = joints.collect();
                let whole = rectified(&n.whole, &mut params, &joints);
                recur(&n.gru(), &mut params, &whole, &mut states[0]);
                let sum = still.iter().zip(&states[0]).map(|(a, b)| a + b);
                rectified(&n.decoder, &mut params, &sum.collect::<Vec<_>>())
            }
            Encoder::Plain(_) => unreachable!("not a published one"),
        }
    };
    (0..poses.len()).map(one).collect()
}

#[test]
fn every_network_is_its_formula_written_out_in_double_precision_over_a_sequence() {
    let stage = Stage::new();
    let poses = &stage.motion.poses[20..32];
    for encoder in stage.encoders() {
        let name = encoder.name();
        let model = stage.model(encoder);
        model.check().expect("it fits");
        let mut player = stage.player(&model);
        let got = stage.play(&mut player, poses);
        let want = codes(&stage, &model, poses);
        assert!(want.iter().flatten().any(|x| x.abs() > 0.05), "{name}");
        for (got, want) in got.iter().flatten().zip(want.iter().flatten()) {
            let error = (got - want).abs();
            assert!(error < 1e-3 * want.abs().max(1.0), "{name}: {got} {want}");
        }
        player.begin(STEP);
        let again = stage.play(&mut player, poses);
        assert_eq!(again, got, "{name}: nothing is left of the sequence before");
    }
}

#[test]
fn without_motion_the_moving_code_is_exactly_zero_and_its_level_changes_nothing() {
    let stage = Stage::new();
    let [.., ncs] = stage.encoders();
    let model = stage.model(ncs);
    let play = |level: f32, poses: &[Pose]| {
        let mut player = stage.player(&model);
        player.set_motion_level(level);
        stage.play(&mut player, poses)
    };
    let held = vec![stage.motion.poses[25].clone(); 6];
    assert_eq!(play(1.0, &held), play(0.0, &held));
    assert_eq!(play(9.0, &held), play(0.0, &held));
    let poses = &stage.motion.poses[20..30];
    let (none, some, more) = (play(0.0, poses), play(0.7, poses), play(1.0, poses));
    assert_eq!(none[0], more[0], "the body comes without motion");
    assert!(none[9] != some[9] && some[9] != more[9]);
}

#[test]
fn the_way_the_body_faces_does_not_matter() {
    let stage = Stage::new();
    let poses = &stage.motion.poses[20..30];
    let turn = glam::DQuat::from_rotation_y(2.4);
    let turned = |pose: &Pose| {
        let mut pose = pose.clone();
        pose.rotations[0] = turn * pose.rotations[0];
        pose.root = turn * pose.root;
        pose
    };
    let turned: Vec<Pose> = poses.iter().map(turned).collect();
    for encoder in stage.encoders() {
        let model = stage.model(encoder);
        let play = |poses: &[Pose]| stage.play(&mut stage.player(&model), poses);
        let (a, b) = (play(poses), play(&turned));
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!((a - b).abs() < 2e-3 * a.abs().max(1.0), "{a} {b}");
        }
    }
}

#[test]
fn stored_and_read_again_it_is_the_same_kind_and_what_is_missing_is_named() {
    let stage = Stage::new();
    for encoder in stage.encoders() {
        let model = stage.model(encoder);
        let whole = model.to_weights();
        let back = Model::from_weights(&whole).expect("it was just written");
        assert_eq!(back.encoder, model.encoder);
        assert_eq!(Model::from_weights(&back.to_weights()), Ok(back));
        for name in whole.arrays.keys() {
            let mut cut = whole.clone();
            cut.arrays.remove(name);
            let fault = Model::from_weights(&cut).expect_err("an array is missing");
            assert!(fault.to_string().contains(name.as_str()), "{fault}");
            let mut other = whole.clone();
            other.arrays.get_mut(name).expect("it is there").numbers = Numbers::U32(vec![7; 5]);
            assert!(Model::from_weights(&other).is_err(), "{name}");
        }
        if matches!(model.encoder, Encoder::Snug(_)) {
            // It would be told another body than it has room for.
            let net = Mlp {
                widths: vec![1, 2],
                bend: Nonlinear::Silu,
                bias: true,
            };
            let mut told = model.clone();
            told.traits = vec![Trait {
                name: "weight".into(),
                value: 0.5,
                range: [0.0, 1.0],
            }];
            told.resizer = Some(Resizer {
                params: vec![0.0; net.n_params()],
                modes: vec![0.0; 6 * told.n_verts()],
                net,
            });
            assert!(told.check().is_err());
        }
        let mut unknown = whole.clone();
        unknown.notes.insert("network".into(), "vae".into());
        let fault = Model::from_weights(&unknown).expect_err("no such network");
        assert!(fault.to_string().contains("vae"), "{fault}");
    }
}
