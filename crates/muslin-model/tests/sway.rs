//! Swings, against the formula in plain loops and double precision.

use glam::{DAffine3, DMat3, DVec3};
use muslin_body::{Avatar, Figure, Pose, Shape, motions};
use muslin_model::{Encoder, Model, Player, Reader, Skin, Sway, Wall};
use muslin_net::learn::{Mlp, Noise, Nonlinear};
use muslin_net::{Array, Numbers};

const VERTS: usize = 29;
const SWINGS: usize = 5;
const STEP: f64 = 1.0 / 30.0;

/// Random cloth on two bones, whose pose mixes two shapes and which swings in five.
fn model() -> Model {
    let mut noise = Noise::new(5);
    let drivers: Vec<String> = ["root", "upperarm01.L"].map(str::to_owned).into();
    let encoder = Mlp {
        widths: vec![Reader::n_inputs_of(drivers.len()), 4, 2],
        bend: Nonlinear::Silu,
        bias: true,
    };
    let mut skin = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for v in 0..VERTS {
        let w = 0.2 + 0.6 * noise.unit() as f32;
        skin.bones.extend([0, 1]);
        skin.weights.extend([w, 1.0 - w]);
        skin.starts.push(2 * (v as u32 + 1));
    }
    let sway = Sway {
        shapes: noise.normals(3 * VERTS * SWINGS),
        stiffness: vec![40.0, 90.0, 150.0, 300.0, 500.0],
        damping: vec![1.0, 2.0, 3.0, 4.0, 5.0],
        samples: vec![3, 11, 20],
        masses: vec![0.02, 0.03, 0.04],
        means: noise.normals(3 * 3 * SWINGS),
        ..Sway::default()
    };
    Model {
        notes: Default::default(),
        faces: vec![[0, 1, 2]],
        template: (0..VERTS)
            .map(|_| std::array::from_fn(|_| noise.normal() as f32))
            .collect(),
        bones: ["spine03", "upperarm01.L"].map(str::to_owned).into(),
        skin,
        scale: vec![[0.1, 1.3]; encoder.widths[0]],
        drivers,
        params: encoder.start(&mut noise),
        encoder: Encoder::Plain(encoder),
        modes: noise
            .normals(3 * VERTS * 3)
            .iter()
            .map(|x| 0.02 * x)
            .collect(),
        traits: Vec::new(),
        sway: Some(sway),
        resizer: None,
    }
}

fn still(model: &Model) -> Model {
    Model {
        sway: None,
        ..model.clone()
    }
}

struct Body {
    avatar: Avatar,
    figure: Figure,
}

impl Body {
    fn new() -> Body {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        Body { avatar, figure }
    }

    fn poses(&self, name: &str) -> Vec<Pose> {
        let made = motions::make(&self.avatar, &self.figure, name, 1.0 / STEP);
        made.expect("a built-in motion").poses[..24].to_vec()
    }

    /// How far a vertex is at most from where it is if the room is turned about [m].
    fn off_if_turned(&self, model: &Model, motion: &str) -> f64 {
        let poses = self.poses(motion);
        let turn = glam::DQuat::from_rotation_y(2.2);
        let pivot = self.figure.joints[0];
        let turned: Vec<Pose> = (poses.iter().cloned())
            .map(|mut p| {
                p.rotations[0] = turn * p.rotations[0];
                p.root = turn * p.root;
                p
            })
            .collect();
        let [a, b] = [poses, turned].map(|poses| self.play(model, &poses, 1.0));
        let off = a.iter().flatten().zip(b.iter().flatten());
        let off = off.map(|(p, q)| q.distance(pivot + turn * (*p - pivot)));
        off.fold(0.0, f64::max)
    }

    fn play(&self, model: &Model, poses: &[Pose], level: f32) -> Vec<Vec<DVec3>> {
        let mut player = Player::new(model, &self.avatar).expect("the bones are there");
        player.begin(STEP);
        player.set_motion_level(level);
        let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let one = |pose: &Pose| {
            let mut out = vec![[0.0f32; 3]; VERTS];
            player.frame(pose, &self.avatar.bones(&self.figure, pose), &mut out);
            out.iter().map(wide).collect()
        };
        poses.iter().map(one).collect()
    }

    /// The mean turn of the bones of a vertex.
    fn turn(&self, model: &Model, v: usize, bones: &[DAffine3]) -> DMat3 {
        let of = |(b, w): (usize, f32)| {
            let bone = self.avatar.bone(&model.bones[b]).expect("a bone");
            bones[bone].matrix3 * f64::from(w)
        };
        model.skin.row(v).map(of).fold(DMat3::ZERO, |a, m| a + m)
    }
}

fn mix(rows: &[f32], q: &[f64]) -> DVec3 {
    let dot = |row: &[f32]| {
        row.iter()
            .zip(q)
            .map(|(a, b)| f64::from(*a) * b)
            .sum::<f64>()
    };
    DVec3::from_array(std::array::from_fn(|c| {
        dot(&rows[c * q.len()..(c + 1) * q.len()])
    }))
}

/// Solves a small system by elimination.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for j in 0..n {
        for i in j + 1..n {
            let f = a[i][j] / a[j][j];
            let pivot = a[j].clone();
            a[i].iter_mut().zip(&pivot).for_each(|(x, p)| *x -= f * p);
            b[i] -= f * b[j];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|c| a[i][c] * b[c]).sum();
        b[i] = (b[i] - known) / a[i][i];
    }
    b
}

/// The codes of every frame: BDF2 for the samples, written out.
fn codes(body: &Body, model: &Model, poses: &[Pose]) -> Vec<Vec<f64>> {
    let sway = model.sway.as_ref().expect("it swings");
    let rest = body.play(&still(model), poses, 1.0);
    let tau = 2.0 / 3.0 * STEP;
    let k = SWINGS;
    let mut out: Vec<Vec<f64>> = Vec::new();
    // Positions and velocities of every sample in every frame.
    let mut x: Vec<Vec<DVec3>> = Vec::new();
    let mut v: Vec<Vec<DVec3>> = Vec::new();
    for (f, pose) in poses.iter().enumerate() {
        let bones = body.avatar.bones(&body.figure, pose);
        let y: Vec<DVec3> = sway.samples.iter().map(|s| rest[f][*s as usize]).collect();
        if f < 2 {
            let speed = |i: usize| match f {
                0 => DVec3::ZERO,
                _ => (y[i] - x[0][i]) / STEP,
            };
            v.push((0..3).map(speed).collect());
            x.push(y);
            out.push(vec![0.0; k]);
            continue;
        }
        // What was before the second frame went along with the body as well.
        let before = |i: usize| match f {
            2 => (x[1][i] - v[1][i] * STEP, v[1][i]),
            _ => (x[f - 2][i], v[f - 2][i]),
        };
        let old = |i: usize| if f == 2 { 0.0 } else { out[f - 2][i] };
        let mut a = vec![vec![0.0; k]; k];
        let mut b = vec![0.0; k];
        for i in 0..3 {
            let (x2, v2) = before(i);
            let free = (x[f - 1][i] * 4.0 - x2) / 3.0 + (v[f - 1][i] * 4.0 - v2) * (tau / 3.0);
            let turn = body.turn(model, sway.samples[i] as usize, &bones);
            let pull = turn.transpose() * (free - y[i]);
            let m = f64::from(sway.masses[i]) / (tau * tau);
            for c in 0..3 {
                let row: Vec<f64> = (0..k)
                    .map(|j| f64::from(sway.means[(3 * i + c) * k + j]))
                    .collect();
                for p in 0..k {
                    b[p] += m * row[p] * pull[c];
                    (0..k).for_each(|q| a[p][q] += m * row[p] * row[q]);
                }
            }
        }
        for p in 0..k {
            let d = f64::from(sway.damping[p]) / tau;
            a[p][p] += d + f64::from(sway.stiffness[p]);
            b[p] += d * (4.0 * out[f - 1][p] - old(p)) / 3.0;
        }
        let q = solve(a, b);
        let at = |i: usize| {
            let turn = body.turn(model, sway.samples[i] as usize, &bones);
            y[i] + turn * mix(&sway.means[3 * i * k..3 * (i + 1) * k], &q)
        };
        let here: Vec<DVec3> = (0..3).map(at).collect();
        let speed = |i: usize| (here[i] - (x[f - 1][i] * 4.0 - before(i).0) / 3.0) / tau;
        v.push((0..3).map(speed).collect());
        x.push(here);
        out.push(q);
    }
    out
}

#[test]
fn frames_swing_as_the_formula_says() {
    let (body, model) = (Body::new(), model());
    let sway = model.sway.as_ref().expect("it swings");
    let poses = body.poses("run");
    let played = body.play(&model, &poses, 0.6);
    let rest = body.play(&still(&model), &poses, 1.0);
    let codes = codes(&body, &model, &poses);
    let mut most = 0.0f64;
    for (f, pose) in poses.iter().enumerate() {
        let bones = body.avatar.bones(&body.figure, pose);
        for v in 0..VERTS {
            let rows = &sway.shapes[3 * v * SWINGS..3 * (v + 1) * SWINGS];
            let swing = body.turn(&model, v, &bones) * mix(rows, &codes[f]) * 0.6;
            let got = played[f][v] - rest[f][v];
            assert!(
                got.distance(swing) < 2e-4 * (1.0 + swing.length()),
                "{f} {v}: {got} {swing}"
            );
            most = most.max(swing.length());
        }
    }
    assert!(most > 0.01, "{most} m of swing");
}

#[test]
fn who_stands_still_or_goes_straight_on_swings_by_nothing_and_turning_the_room_turns_the_swing() {
    let (body, model) = (Body::new(), model());
    let stand = vec![body.poses("wave")[5].clone(); 300];
    let rest = body.play(&still(&model), &stand[..1], 1.0);
    let stood = body.play(&model, &stand, 1.0);
    for frame in &stood {
        for ((x, first), y) in frame.iter().zip(&stood[0]).zip(&rest[0]) {
            assert!(x.distance(*first) < 1e-6, "drifts to {x} from {first}");
            // Without swings other steps stand for the shapes.
            assert!(x.distance(*y) < 1e-5, "stands at {x} instead of {y}");
        }
    }
    let mut glide = stand;
    for (k, pose) in glide.iter_mut().enumerate() {
        pose.root += DVec3::X * (1.5 * STEP * k as f64);
    }
    let rest = body.play(&still(&model), &glide, 1.0);
    for (frame, rest) in body.play(&model, &glide, 1.0).iter().zip(&rest) {
        let off = frame.iter().zip(rest).map(|(x, y)| x.distance(*y));
        assert!(off.fold(0.0, f64::max) < 1e-3, "at a steady pace");
    }
    assert!(body.off_if_turned(&model, "wave") < 1e-4);
}

#[test]
fn a_stored_model_swings_alike_and_parts_that_do_not_fit_are_refused() {
    let (body, model) = (Body::new(), model());
    let back = Model::from_weights(&model.to_weights()).expect("it was just written");
    assert!(back.has_motion_level() && !still(&back).has_motion_level());
    let poses = body.poses("wave");
    let (a, b) = (
        body.play(&model, &poses, 1.0),
        body.play(&back, &poses, 1.0),
    );
    let far = a.iter().flatten().zip(b.iter().flatten());
    assert!(far.map(|(p, q)| p.distance(*q)).fold(0.0, f64::max) < 0.02);
    assert_eq!(Model::from_weights(&back.to_weights()), Ok(back.clone()));
    let none = Model::from_weights(&still(&model).to_weights()).expect("without swings");
    assert_eq!(none.sway, None);
    let whole = model.to_weights();
    let parts = whole.arrays.keys().filter(|k| k.starts_with("sway."));
    for name in parts.filter(|k| *k != "sway.shapes") {
        let mut cut = whole.clone();
        cut.arrays.remove(name);
        let fault = Model::from_weights(&cut).expect_err("an array is missing");
        assert!(fault.to_string().contains(name.as_str()), "{fault}");
    }
    for spoil in [
        (|s: &mut Sway| s.samples[1] = 99) as fn(&mut Sway),
        |s| s.stiffness[0] = -1.0,
        |s| s.masses = vec![0.0; 3],
        |s| s.damping[2] = f32::NAN,
    ] {
        let mut other = model.clone();
        spoil(other.sway.as_mut().expect("it swings"));
        assert!(Model::from_weights(&other.to_weights()).is_err());
    }
}

#[test]
fn cloth_swings_no_farther_into_the_skin_than_the_pose_leaves_room_and_the_file_keeps_that() {
    let body = Body::new();
    let free = model();
    let poses = body.poses("run");
    let (v, out, near) = (7usize, DVec3::new(0.6, 0.0, 0.8), 4e-3f64);
    // Skin follows the bones a little differently: with the pose's own shapes, every pose leaves another room.
    let foot = DVec3::from_array(free.template[v].map(f64::from)) - 0.038 * out;
    let mut row: Vec<(usize, f32)> = free.skin.row(v).collect();
    row[0].1 += 0.1;
    row[1].1 -= 0.1;
    let wall = Wall {
        vertex: v as u32,
        foot: foot.as_vec3().to_array(),
        out: out.as_vec3().to_array(),
        bones: [row[0].0 as u8, row[1].0 as u8, 0, 0],
        weights: [row[0].1, row[1].1, 0.0, 0.0],
    };
    let mut held = free.clone();
    held.sway.as_mut().expect("it swings").walls = vec![wall];
    let held = Model::from_weights(&held.to_weights()).expect("a sound model");
    assert_eq!(held.sway.as_ref().expect("it swings").walls, [wall]);
    // How far in front of the skin the cloth is in every pose [m].
    let before = |model: &Model| -> Vec<f64> {
        let all = body.play(model, &poses, 1.0);
        let one = |(f, pose): (usize, &Pose)| {
            let bones = body.avatar.bones(&body.figure, pose);
            let (mut at, mut way) = (DVec3::ZERO, DVec3::ZERO);
            for (b, w) in &row {
                let bone = bones[body.avatar.bone(&model.bones[*b]).expect("a bone")];
                at += bone.transform_point3(foot) * f64::from(*w);
                way += bone.matrix3 * out * f64::from(*w);
            }
            way.normalize().dot(all[f][v] - at)
        };
        poses.iter().enumerate().map(one).collect()
    };
    let (rest, without, with) = (before(&still(&held)), before(&free), before(&held));
    let most = rest.iter().copied().fold(0.0, f64::max);
    assert!(rest.iter().any(|r| *r < most - 5e-3), "{rest:?}");
    let mut pushed = 0;
    for ((rest, without), with) in rest.iter().zip(&without).zip(&with) {
        let least = near.min(*rest - 1e-3);
        pushed += usize::from(*without < least - 2e-3);
        assert!(*with > least - 1e-3, "{with} of {least}");
    }
    assert!(pushed > 3, "{rest:?} {without:?}");
    for spoil in [
        (|w| w.vertex = VERTS as u32) as fn(&mut Wall),
        |w| w.bones[1] = 2,
        |w| w.weights[0] = 2.0,
        |w| w.out[1] = f32::NAN,
    ] {
        let mut bent = held.clone();
        spoil(&mut bent.sway.as_mut().expect("it swings").walls[0]);
        assert!(bent.check().is_err());
    }
}

#[test]
fn points_that_cloth_joins_swing_no_farther_apart_than_it_is_long_and_others_do() {
    let body = Body::new();
    let mut loose = model();
    let sway = loose.sway.as_mut().expect("it swings");
    let points: Vec<usize> = sway.samples.iter().map(|v| *v as usize).collect();
    // What stands for the cloth around a point moves as the point does.
    let row = |v: &usize| sway.shapes[3 * v * SWINGS..][..3 * SWINGS].to_vec();
    sway.means = points.iter().flat_map(row).collect();
    for (v, at) in points
        .iter()
        .zip([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.0, 0.05, 0.0]])
    {
        loose.template[*v] = at;
    }
    let tied = Model {
        faces: vec![[3, 11, 20]],
        ..loose.clone()
    };
    let poses = body.poses("run");
    let all = |model: &Model| body.play(model, &poses, 1.0);
    let (rest, without, with) = (all(&still(&tied)), all(&loose), all(&tied));
    let wide = |v: usize| DVec3::from_array(tied.template[v].map(f64::from));
    let mut parted = 0;
    for (a, b) in [(3, 11), (11, 20), (20, 3)] {
        let long = 1.05 * wide(a).distance(wide(b));
        for f in 0..poses.len() {
            let apart = |x: &[Vec<DVec3>]| x[f][a].distance(x[f][b]);
            let most = apart(&rest).max(long);
            assert!(
                apart(&with) < 1.02 * most,
                "{f}: {} of {most}",
                apart(&with)
            );
            parted += usize::from(apart(&without) > 1.2 * most);
        }
    }
    assert!(parted > 5, "{parted}");
    let moved = |(x, y): (&Vec<DVec3>, &Vec<DVec3>)| x[3].distance(y[3]);
    let most = with.iter().zip(&rest).map(moved).fold(0.0, f64::max);
    assert!(most > 5e-3, "{most}");
}

#[test]
fn two_points_that_swings_hardly_move_apart_throw_no_other_cloth_about() {
    let mut tied = model();
    let sway = tied.sway.as_mut().expect("it swings");
    // The second swings as the first does, but for a millionth.
    let per = 3 * SWINGS;
    let (first, rest) = sway.means.split_at_mut(per);
    for (to, from) in rest[..per].iter_mut().zip(first) {
        *to = *from + 1e-6 * *to;
    }
    let [a, b] = [0, 1].map(|i| sway.samples[i] as usize);
    let weights = tied.skin.weights[2 * a..2 * a + 2].to_vec();
    tied.skin.weights[2 * b..2 * b + 2].copy_from_slice(&weights);
    tied.template[b] = tied.template[a].map(|x| x + 0.02);
    tied.faces = vec![[a as u32, b as u32, 5]];
    // Poses alone leave them farther apart than cloth between them is long: as far they may be.
    tied.modes[9 * b..9 * (b + 1)]
        .iter_mut()
        .for_each(|m| *m *= 50.0);
    let off = Body::new().off_if_turned(&tied, "run");
    assert!(off < 1e-3, "{off} m");
}

#[test]
fn joined_cloth_swings_in_more_ways_than_ties_have_room_for_as_if_it_were_not_joined() {
    let body = Body::new();
    let (mut many, mut noise, n) = (model(), Noise::new(8), 70);
    let sway = many.sway.as_mut().expect("it swings");
    sway.shapes = noise.normals(3 * VERTS * n);
    sway.means = noise.normals(3 * 3 * n);
    (sway.stiffness, sway.damping) = (vec![100.0; n], vec![2.0; n]);
    let joined = Model {
        faces: vec![[3, 11, 20]],
        ..many.clone()
    };
    let poses = body.poses("run");
    let all = |model: &Model| body.play(model, &poses, 1.0);
    assert_eq!(all(&joined), all(&many));
}

#[test]
fn a_file_whose_walls_know_the_skin_at_rest_alone_has_its_swings_found_anew() {
    let mut old = model().to_weights();
    let room = Array::new(&[1, 4], Numbers::F32(vec![0.0, 0.0, 1.0, 1e-3]));
    old.arrays.insert("sway.rooms".into(), room);
    let read = Model::from_weights(&old).expect("a sound model");
    assert_eq!(read, still(&read));
    assert_eq!(read.template, model().template);
}
