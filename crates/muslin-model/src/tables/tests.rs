//! The kernels before the player: they run on this machine's processor, where it has a C compiler.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use glam::{DAffine3, Vec3};
use muslin_body::{Avatar, Pose, Shape, motions};
use muslin_net::learn::{Mlp, Noise, Nonlinear};

use super::*;
use crate::reading::Reading;
use crate::{Crowd, CrowdError, Reader, Wall};

const STEP: f64 = 1.0 / 30.0;
/// Wearers and moments.
const WEARERS: usize = 2;
const MOMENTS: usize = 22;
/// Vertices around and along the garment.
const AROUND: usize = 12;
const ALONG: usize = 8;

/// A tube around the hips that hangs on them and on the legs, and swings widely.
fn tube(bend: Nonlinear, bends_last: bool, swings: usize) -> Model {
    let mut noise = Noise::new(7);
    let n = AROUND * ALONG;
    let drivers: Vec<String> = ["root", "spine05", "upperleg01.L", "upperleg01.R"]
        .map(str::to_owned)
        .into();
    let inputs = match bends_last {
        true => 3 * drivers.len(),
        false => Reader::n_inputs_of(drivers.len()),
    };
    let mlp = Mlp {
        widths: vec![inputs, 9, 11, 5],
        bend,
        bias: true,
    };
    let at = |v: usize| {
        let angle = std::f32::consts::TAU * (v % AROUND) as f32 / AROUND as f32;
        let (radius, down) = (0.17, 0.06 * (v / AROUND) as f32);
        Vec3::new(radius * angle.sin(), 0.95 - down, radius * angle.cos())
    };
    let mut skin = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for v in 0..n {
        // Vertices follow one to three bones.
        let down = (v / AROUND) as f32 / ALONG as f32;
        let left = 0.5 + 0.5 * (at(v).x / 0.17);
        let row = [(0, 1.0 - down), (1, down * left), (2, down * (1.0 - left))];
        for (b, w) in row.into_iter().filter(|e| e.1 > 0.0) {
            skin.bones.push(b);
            skin.weights.push(w);
        }
        skin.starts.push(skin.bones.len() as u32);
    }
    let quads = (0..(ALONG - 1) * AROUND).map(|v| {
        let next = if v % AROUND == AROUND - 1 {
            v + 1 - AROUND
        } else {
            v + 1
        };
        [v, v + AROUND, next + AROUND, next].map(|v| v as u32)
    });
    let encoder = match bends_last {
        true => Encoder::Pbns(mlp.clone()),
        false => Encoder::Plain(mlp.clone()),
    };
    Model {
        notes: BTreeMap::new(),
        faces: quads
            .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
            .skip(3)
            .collect(),
        template: (0..n).map(|v| at(v).to_array()).collect(),
        bones: ["root", "upperleg01.L", "upperleg01.R"]
            .map(str::to_owned)
            .into(),
        skin: skin.clone(),
        drivers,
        traits: Vec::new(),
        scale: vec![[0.1, 1.3]; inputs],
        params: mlp.start(&mut noise),
        encoder,
        modes: noise.normals(3 * n * 6).iter().map(|x| 0.01 * x).collect(),
        sway: (swings > 0).then(|| sway(&mut noise, swings, &skin, at)),
        resizer: None,
    }
}

fn sway(noise: &mut Noise, k: usize, skin: &Skin, at: impl Fn(usize) -> Vec3) -> Sway {
    let n = AROUND * ALONG;
    // Smooth shapes, which grow towards the hem.
    let waves: Vec<Vec3> = (0..2 * k)
        .map(|_| Vec3::from_array(std::array::from_fn(|_| noise.normal() as f32)))
        .collect();
    let shape = |v: usize, c: usize| {
        let down = (v / AROUND) as f32 / ALONG as f32;
        down * (waves[2 * c] + at(v).x / 0.17 * waves[2 * c + 1])
    };
    let rows = |verts: &mut dyn Iterator<Item = usize>| -> Vec<f32> {
        let axes = verts.flat_map(|v| (0..3).map(move |a| (v, a)));
        axes.flat_map(|(v, a)| (0..k).map(move |c| (v, a, c)))
            .map(|(v, a, c)| shape(v, c)[a])
            .collect()
    };
    let samples: Vec<u32> = (0..n as u32).step_by(3).collect();
    let wall = |v: usize| {
        let row: Vec<(usize, f32)> = skin.row(v).collect();
        let out = Vec3::new(at(v).x, 0.0, at(v).z).normalize();
        Wall {
            vertex: v as u32,
            foot: (at(v) - 0.01 * out).to_array(),
            out: out.to_array(),
            bones: std::array::from_fn(|i| row.get(i).map_or(0, |e| e.0 as u8)),
            weights: std::array::from_fn(|i| row.get(i).map_or(0.0, |e| e.1)),
        }
    };
    Sway {
        shapes: rows(&mut (0..n)),
        stiffness: (0..k).map(|c| 30.0 + 40.0 * c as f32).collect(),
        damping: vec![2.0; k],
        masses: vec![0.01; samples.len()],
        means: rows(&mut samples.iter().map(|v| *v as usize)),
        walls: (0..n).step_by(2).map(wall).collect(),
        samples,
    }
}

/// The same where neither walls nor ties hold it.
fn unheld() -> Model {
    let mut model = tube(Nonlinear::Tanh, false, 5);
    let sway = model.sway.as_mut().expect("it swings");
    sway.walls.clear();
    // One point is tied to none.
    sway.samples.truncate(1);
    sway.masses.truncate(1);
    sway.means.truncate(15);
    model
}

/// The kernels made for this machine, with so many frames a block; nothing where it has no C compiler.
fn emulated(frames: u32) -> Option<PathBuf> {
    if Command::new("cc").arg("--version").output().is_err() {
        println!("skipped: no C compiler (cc)");
        return None;
    }
    let test = std::env::current_exe().expect("a test is a file");
    let program = test.with_file_name(format!("kernels-{frames}"));
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/src/cuda/emulated.c");
    let built = Command::new("cc")
        .args(["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror"])
        .args(["-Wno-unknown-pragmas", &format!("-DFRAMES={frames}")])
        .args([source, "-lm", "-pthread", "-o"])
        .arg(&program)
        .output()
        .expect("it can be run");
    let said = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{said}");
    Some(program)
}

/// Poses of all wearers, moment after moment: each is at another place of a wild dance.
fn poses(avatar: &Avatar) -> Vec<Pose> {
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let dance = motions::make(avatar, &figure, "dance", 1.0 / STEP).expect("a built-in motion");
    (0..MOMENTS)
        .flat_map(|m| (0..WEARERS).map(move |w| 3 * m + 17 * w))
        .map(|k| dance.poses[k % dance.poses.len()].clone())
        .collect()
}

/// Vertices and normals of all frames, by the kernels.
fn by_kernels(
    program: &PathBuf,
    (model, level): (&Model, f32),
    (avatar, poses): (&Avatar, &[(&Pose, &[DAffine3])]),
) -> [Vec<[f32; 3]>; 2] {
    let mut tables = Tables::new(model).expect("a network without memory");
    tables.begin(STEP);
    let mut reading = Reading::new(model, avatar).expect("the bones are there");
    let (n, m) = (reading.n_inputs(), reading.n_bones());
    let mut input = vec![0.0f32; n * poses.len()];
    let mut bones = vec![[0.0f32; 12]; m * poses.len()];
    let room = input.chunks_mut(n).zip(bones.chunks_mut(m));
    for (pose, (input, own)) in poses.iter().zip(room) {
        reading.read(*pose, input, own);
    }
    let net = &tables.network;
    let counts = [
        WEARERS,
        MOMENTS,
        tables.floats.len(),
        tables.numbers.len(),
        net.widths.len() - 1,
        net.bend as usize,
        usize::from(net.bends_last),
    ];
    let mut told: Vec<u8> = counts
        .iter()
        .flat_map(|n| (*n as u32).to_le_bytes())
        .collect();
    let floats = |told: &mut Vec<u8>, x: &[f32]| {
        told.extend(x.iter().flat_map(|x| x.to_le_bytes()));
    };
    floats(&mut told, &[level]);
    told.extend(tables.layout.bytes());
    floats(&mut told, &tables.floats);
    told.extend(tables.numbers.iter().flat_map(|x| x.to_le_bytes()));
    told.extend(net.widths.iter().flat_map(|x| x.to_le_bytes()));
    floats(&mut told, &net.params);
    floats(&mut told, &input);
    floats(&mut told, bones.as_flattened());

    let mut run = Command::new(program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it was built");
    let mut pipe = run.stdin.take().expect("it is told through a pipe");
    pipe.write_all(&told).expect("it reads all");
    drop(pipe);
    let done = run.wait_with_output().expect("it ends");
    assert!(done.status.success(), "{}", done.status);
    let all: Vec<f32> = (done.stdout.as_chunks::<4>().0.iter())
        .map(|b| f32::from_le_bytes(*b))
        .collect();
    let (x, normals) = all.split_at(all.len() / 2);
    [x, normals].map(|part| part.as_chunks::<3>().0.to_vec())
}

/// All frames of a crowd, vertices and normals; told in two parts, so that the second goes on from the first.
fn by_crowd(mut crowd: Crowd, level: f32, dance: &Dance) -> Result<[Vec<[f32; 3]>; 2], CrowdError> {
    crowd.begin(STEP)?;
    crowd.set_motion_level(level);
    let (n, all) = (crowd.n_verts(), dance.all());
    let mut out = [(); 2].map(|()| vec![[0.0f32; 3]; n * all.len()]);
    let [x, normals] = &mut out;
    let mut room = x.chunks_mut(n).zip(normals.chunks_mut(n));
    for part in all.chunks(MOMENTS / 2 * WEARERS) {
        crowd.play(part)?;
        for (moment, wearer) in (0..MOMENTS / 2).flat_map(|m| (0..WEARERS).map(move |w| (m, w))) {
            let to = room.next().expect("as many frames as poses");
            crowd.read((moment, wearer), to)?;
        }
    }
    Ok(out)
}

/// The avatar, and what all wearers do.
struct Dance {
    avatar: Avatar,
    poses: Vec<Pose>,
    bones: Vec<Vec<DAffine3>>,
}

impl Dance {
    fn new() -> Dance {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let poses = poses(&avatar);
        let bones = poses.iter().map(|p| avatar.bones(&figure, p)).collect();
        Dance {
            avatar,
            poses,
            bones,
        }
    }

    fn all(&self) -> Vec<(&Pose, &[DAffine3])> {
        self.poses
            .iter()
            .zip(self.bones.iter().map(Vec::as_slice))
            .collect()
    }
}

/// How far the one is from the other: at most, and in the mean.
fn far(got: &[[f32; 3]], want: &[[f32; 3]]) -> [f32; 2] {
    assert_eq!(got.len(), want.len());
    let pairs = got.iter().zip(want);
    let far = pairs.map(|(a, b)| Vec3::from_array(*a).distance(Vec3::from_array(*b)));
    let all: Vec<f32> = far.collect();
    assert!(all.iter().all(|x| x.is_finite()));
    let most = all.iter().fold(0.0f32, |a, b| a.max(*b));
    [most, all.iter().sum::<f32>() / all.len() as f32]
}

/// How far the kernels are from the player: at most, and in the mean [m]; and in normals at most.
fn apart(model: &Model, frames: u32, level: f32) -> Option<[f32; 3]> {
    let (program, dance) = (emulated(frames)?, Dance::new());
    let got = by_kernels(&program, (model, level), (&dance.avatar, &dance.all()));
    Some(compared(got, (model, level), &dance))
}

fn compared(got: [Vec<[f32; 3]>; 2], (model, level): (&Model, f32), dance: &Dance) -> [f32; 3] {
    let crowd = Crowd::on_cores(model, &dance.avatar, WEARERS).expect("the bones are there");
    let want = by_crowd(crowd, level, dance).expect("cores do not fail");
    let [most, mean] = far(&got[0], &want[0]);
    let apart = [most, mean, far(&got[1], &want[1])[0]];
    println!("{}: {apart:?}", model.encoder.name());
    apart
}

#[test]
fn kernels_drape_what_the_player_does() {
    let still = tube(Nonlinear::Silu, false, 0);
    let pbns = tube(Nonlinear::Relu, true, 0);
    let swinging = unheld();
    for (model, frames, level) in [(still, 4, 1.0), (pbns, 1, 1.0), (swinging, 16, 0.7)] {
        let Some([x, _, normal]) = apart(&model, frames, level) else {
            return;
        };
        // Shapes in 16-bit steps are the player's.
        assert!(x < 2e-5 && normal < 2e-3, "{x} m, normals {normal}");
    }
}

/// Three rounds over walls and ties end before they have come to rest: what differs in the last bit may end apart by
/// half a millimetre, and does so in a player as well when its shapes are moved by two thousandths of one.
#[test]
fn kernels_hold_swings_as_the_player_does() {
    let model = tube(Nonlinear::Tanh, false, 5);
    let free = |walls: bool, ties: bool| {
        let mut free = model.clone();
        if walls {
            free.sway.as_mut().expect("it swings").walls.clear();
        }
        if ties {
            free.faces.clear();
        }
        free
    };
    let dance = Dance::new();
    let on_cores = |model: &Model| {
        let crowd = Crowd::on_cores(model, &dance.avatar, WEARERS).expect("the bones are there");
        let [x, _] = by_crowd(crowd, 1.0, &dance).expect("cores do not fail");
        x
    };
    let held = on_cores(&model);
    for (walls, ties) in [(true, false), (false, true)] {
        let [_, mean] = far(&on_cores(&free(walls, ties)), &held);
        assert!(mean > 2e-3, "walls and ties hold nothing back here: {mean}");
    }
    let Some([_, mean, _]) = apart(&model, 8, 1.0) else {
        return;
    };
    assert!(mean < 3e-4, "{mean} m in the mean");
}

#[test]
fn a_model_that_names_what_it_lacks_is_refused() {
    let broken = |mend: &dyn Fn(&mut Model)| {
        let mut model = tube(Nonlinear::Tanh, false, 5);
        mend(&mut model);
        Tables::new(&model).err()
    };
    assert_eq!(broken(&|_| {}), None);
    let refused = Some("models whose parts do not fit each other");
    assert_eq!(broken(&|m| m.skin.bones[4] = 3), refused);
    assert_eq!(broken(&|m| drop(m.drivers.pop())), refused);
    let sway = |m: &mut Model, mend: &dyn Fn(&mut Sway)| mend(m.sway.as_mut().expect("it swings"));
    assert_eq!(broken(&|m| sway(m, &|s| s.walls[0].bones[3] = 9)), refused);
    assert_eq!(broken(&|m| sway(m, &|s| s.means.truncate(9))), refused);
}

#[test]
fn networks_that_remember_are_left_to_cores() {
    let mut model = tube(Nonlinear::Silu, false, 0);
    model.encoder = Encoder::Snug(crate::Snug {
        body: Vec::new(),
        widths: vec![15, 5],
    });
    assert_eq!(
        Tables::new(&model).err(),
        Some("networks that remember poses")
    );
}

#[test]
fn a_crowd_on_cores_is_its_players_to_the_last_bit() {
    let (model, dance) = (tube(Nonlinear::Tanh, false, 5), Dance::new());
    let all = dance.all();
    let crowd = Crowd::on_cores(&model, &dance.avatar, WEARERS).expect("the bones are there");
    let [x, normals] = by_crowd(crowd, 0.7, &dance).expect("cores do not fail");
    let n = model.n_verts();
    for wearer in 0..WEARERS {
        let mut player = crate::Player::new(&model, &dance.avatar).expect("the bones are there");
        player.begin(STEP);
        player.set_motion_level(0.7);
        let own: Vec<_> = all.iter().skip(wearer).step_by(WEARERS).copied().collect();
        let [mut alone, mut turned] = [(); 2].map(|()| vec![[0.0f32; 3]; n * MOMENTS]);
        player.frames_with_normals(&own, (&mut alone, &mut turned));
        for moment in 0..MOMENTS {
            let [at, to] = [moment * WEARERS + wearer, moment].map(|k| k * n..(k + 1) * n);
            assert_eq!(x[at.clone()], alone[to.clone()]);
            assert_eq!(normals[at], turned[to]);
        }
    }
}

/// The same bounds as for kernels on this machine's processor.
#[test]
fn a_device_drapes_what_cores_do() {
    let dance = Dance::new();
    let models = [
        tube(Nonlinear::Silu, false, 0),
        tube(Nonlinear::Relu, true, 0),
        unheld(),
    ];
    for (model, most) in models
        .iter()
        .map(|m| (m, 2e-5))
        .chain([(&tube(Nonlinear::Tanh, false, 5), 1.0)])
    {
        let crowd = match Crowd::on_cuda(model, &dance.avatar, WEARERS) {
            Ok(crowd) => crowd,
            Err(why @ (CrowdError::NotBuilt | CrowdError::NoDevice(_))) => {
                println!("skipped: {why}");
                return;
            }
            Err(why) => panic!("{why}"),
        };
        println!("on {}", crowd.place());
        let got = by_crowd(crowd, 1.0, &dance).expect("the device does not fail");
        let [x, mean, normal] = compared(got, (model, 1.0), &dance);
        assert!(x < most && mean < 3e-4, "{x} m, {mean} m in the mean");
        assert!(most == 1.0 || normal < 2e-3, "normals {normal}");
    }
}

#[test]
fn a_crowd_falls_back_to_cores_and_says_where_it_is() {
    let (mut model, dance) = (tube(Nonlinear::Silu, false, 0), Dance::new());
    let crowd = Crowd::new(&model, &dance.avatar, WEARERS).expect("the bones are there");
    if Crowd::on_cuda(&model, &dance.avatar, WEARERS).is_err() {
        assert!(crowd.place().ends_with("core") || crowd.place().ends_with("cores"));
    }
    model.bones[1] = "tail".into();
    let refused = Crowd::new(&model, &dance.avatar, WEARERS).err();
    assert_eq!(refused, Some(crate::ModelError::NoBone("tail".into())));
}
