//! How many frames a second a model plays on one core: `cargo run --release -p muslin-model
//! --example play [VERTICES [CODES [WIDTH [SWINGS [WALLS]]]]]`.
//!
//! The model is made up: a tube around the spine and arms, six bones a vertex, random shapes. What
//! it costs is that of a trained one. Prints the least of many short runs; the posed bones are
//! given, as an engine gives them. Then crowds on all cores, and with `--features cuda` on a CUDA device.

use std::time::Instant;

use glam::DAffine3;
use muslin_body::{Avatar, Pose, Shape, motions};
use muslin_model::{Crowd, CrowdError, Encoder, FOLLOWED, Model, Player, Reader, Skin, Sway, Wall};
use muslin_net::learn::{Mlp, Noise, Nonlinear};

/// Points whose motion stands for the tube's.
const SAMPLES: usize = 96;
/// Bones that the tube lies along.
const BONES: [&str; 12] = [
    "upperleg01.L",
    "root",
    "spine05",
    "spine04",
    "spine03",
    "spine02",
    "spine01",
    "clavicle.L",
    "shoulder01.L",
    "upperarm01.L",
    "upperarm02.L",
    "lowerarm01.L",
];

fn main() {
    let mut args = std::env::args().skip(1).map(|a| a.parse());
    let mut next = |usual| match args.next() {
        Some(Ok(n)) => n,
        _ => usual,
    };
    let (n, codes, width) = (next(12_037), next(64), next(128));
    let (swings, walls) = (next(16), next(400));
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let model = model((n, codes, width), (swings, walls));
    let mut player = Player::new(&model, &avatar).expect("all bones are the body's");
    let walk = motions::make(&avatar, &figure, "walk", 30.0).expect("a built-in motion");
    let poses: Vec<&Pose> = walk.poses.iter().step_by(3).take(32).collect();
    let bones: Vec<_> = poses.iter().map(|p| avatar.bones(&figure, p)).collect();
    let mut out = vec![[0.0f32; 3]; n * poses.len()];
    let single = least(|| {
        for ((pose, bones), out) in poses.iter().zip(&bones).zip(out.chunks_mut(n)) {
            player.frame(pose, bones, out);
        }
    });
    let all: Vec<_> = poses
        .iter()
        .copied()
        .zip(bones.iter().map(Vec::as_slice))
        .collect();
    let batched = least(|| player.frames(&all, &mut out));
    let mut normals = out.clone();
    let alone_turned = least(|| {
        let rooms = out.chunks_mut(n).zip(normals.chunks_mut(n));
        for ((pose, bones), rooms) in poses.iter().zip(&bones).zip(rooms) {
            player.frame_with_normals(pose, bones, rooms);
        }
    });
    let turned = least(|| player.frames_with_normals(&all, (&mut out, &mut normals)));
    let rate = |seconds: f64| poses.len() as f64 / seconds;
    println!(
        "{n} vertices, {codes} codes, width {width}, {swings} swings, {walls} walls: {:.0} frames a second one by one, {:.0} with normals; {:.0} together, {:.0} with normals",
        rate(single),
        rate(alone_turned),
        rate(batched),
        rate(turned)
    );
    let crowds = [
        (
            64,
            Crowd::on_cores(&model, &avatar, 64).map_err(CrowdError::from),
        ),
        (1024, Crowd::on_cuda(&model, &avatar, 1024)),
        (4096, Crowd::on_cuda(&model, &avatar, 4096)),
    ];
    for (wearers, crowd) in crowds {
        // Everybody is somewhere else in the walk.
        let one = |k: usize| all[(k / wearers + 7 * (k % wearers)) % all.len()];
        let told: Vec<_> = (0..4 * wearers).map(one).collect();
        match crowd.and_then(|mut crowd| Ok((crowd.place(), fastest(&mut crowd, &told)?))) {
            Ok((place, rate)) => {
                println!("a crowd of {wearers} on {place}: {rate:.0} frames a second with normals");
            }
            Err(why) => println!("no crowd of {wearers}: {why}"),
        }
    }
}

/// Frames a second at best.
fn fastest(crowd: &mut Crowd, told: &[(&Pose, &[DAffine3])]) -> Result<f64, CrowdError> {
    let mut best = f64::INFINITY;
    for _ in 0..30 {
        let since = Instant::now();
        crowd.play(told)?;
        best = best.min(since.elapsed().as_secs_f64());
    }
    Ok(told.len() as f64 / best)
}

/// The least time of many runs [s].
fn least(mut job: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..600 {
        let since = Instant::now();
        job();
        best = best.min(since.elapsed().as_secs_f64());
    }
    best
}

/// Two triangles a vertex, rings of a hundred and twenty.
fn tube(n: u32) -> Vec<[u32; 3]> {
    let quads = (0..n.saturating_sub(121)).map(|i| [i, i + 1, i + 121, i + 120]);
    quads
        .flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect()
}

/// Skin below a vertex, which follows four of its bones.
fn wall(v: usize, skin: &Skin) -> Wall {
    let mut row: Vec<(usize, f32)> = skin.row(v).collect();
    row.sort_by(|a, b| b.1.total_cmp(&a.1));
    row.truncate(FOLLOWED);
    let sum: f32 = row.iter().map(|e| e.1).sum();
    Wall {
        vertex: v as u32,
        foot: [0.1, 1.2, 0.09],
        out: [0.0, 0.0, 1.0],
        bones: std::array::from_fn(|i| row[i].0 as u8),
        weights: std::array::from_fn(|i| row[i].1 / sum),
    }
}

fn model((n, codes, width): (usize, usize, usize), (swings, walls): (usize, usize)) -> Model {
    let mut noise = Noise::new(3);
    let names = BONES.map(str::to_owned).to_vec();
    let encoder = Mlp {
        widths: vec![Reader::n_inputs_of(names.len()), width, width, codes - 1],
        bend: Nonlinear::Silu,
        bias: true,
    };
    let mut skin = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for v in 0..n {
        let at = (BONES.len() - 1) as f64 * v as f64 / n as f64;
        let first = (at as usize).saturating_sub(2).min(BONES.len() - 6);
        let near = |b: usize| (-0.5 * (b as f64 - at).powi(2)).exp();
        let sum: f64 = (first..first + 6).map(near).sum();
        for b in first..first + 6 {
            skin.bones.push(b as u8);
            skin.weights.push((near(b) / sum) as f32);
        }
        skin.starts.push(skin.bones.len() as u32);
    }
    Model {
        notes: Default::default(),
        faces: tube(n as u32),
        template: vec![[0.1, 1.2, 0.1]; n],
        bones: names.clone(),
        skin: skin.clone(),
        scale: vec![[0.0, 1.0]; encoder.widths[0]],
        drivers: names,
        params: encoder.start(&mut noise),
        encoder: Encoder::Plain(encoder),
        modes: noise
            .normals(3 * n * codes)
            .iter()
            .map(|x| 0.01 * x)
            .collect(),
        traits: Vec::new(),
        sway: Some(Sway {
            shapes: noise.normals(3 * n * swings),
            stiffness: vec![200.0; swings],
            damping: vec![6.0; swings],
            samples: (0..SAMPLES as u32)
                .map(|k| k * (n / SAMPLES) as u32)
                .collect(),
            masses: vec![0.2 / SAMPLES as f32; SAMPLES],
            means: noise.normals(3 * SAMPLES * swings),
            walls: (0..walls)
                .map(|i| wall(i * (n / walls.max(1)), &skin))
                .collect(),
        }),
        resizer: None,
    }
}
