//! What a body costs on one core, as minima of 30 runs:
//! `cargo run --release -p muslin-body --example bench`

use muslin_body::{Avatar, BodyError, Measures, PHENOTYPES, Pose, Shape};
use std::hint::black_box;
use std::time::Instant;

fn main() -> Result<(), BodyError> {
    let avatar = Avatar::embedded()?;
    let shape = Shape::default();
    let figure = avatar.figure(&shape)?;
    let pose = Pose::rest(&avatar);
    let posed = avatar.pose(&figure, &pose);
    println!(
        "vertices {}, modes {}, bones {}",
        avatar.n_verts(),
        avatar.n_modes(),
        avatar.rig().n_bones()
    );
    report("decode the embedded avatar", || {
        drop(black_box(Avatar::embedded()))
    });
    report("shape to figure", || drop(black_box(avatar.figure(&shape))));
    report("pose the figure", || {
        drop(black_box(avatar.pose(&figure, &pose)))
    });
    report("normals", || {
        drop(black_box(posed.normals(avatar.body_faces())))
    });
    report("solve height", || {
        drop(black_box(shape.with_height(&avatar, 1.8)))
    });
    report("solve height and mass", || {
        drop(black_box(shape.with_height_and_mass(&avatar, 1.8, 80.0)))
    });
    report("measure", || {
        black_box(avatar.measure(&figure));
    });
    population(&avatar)
}

/// Process CPU time equals wall time here: nothing runs beside the calling thread.
fn report(what: &str, mut run: impl FnMut()) {
    let mut times: Vec<f64> = (0..30)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!(
        "{what:<28} {:8.3} ms least, {:8.3} ms median",
        times[0], times[15]
    );
}

/// The measures of a few people.
fn population(avatar: &Avatar) -> Result<(), BodyError> {
    println!("{:?}", avatar.measure(&avatar.figure(&Shape::default())?));
    for gender in [0.0, 1.0] {
        let shape = Shape::default().with("gender", gender)?;
        let m: Measures = avatar.measure(&avatar.figure(&shape)?);
        println!("gender {gender}: {m:.3?}");
        for name in PHENOTYPES {
            let ends: Result<Vec<_>, _> = [if name == "age" { 0.667 } else { 0.0 }, 1.0]
                .map(|x| shape.clone().with(name, x).and_then(|s| avatar.figure(&s)))
                .into_iter()
                .collect();
            let ends: Vec<Measures> = ends?.iter().map(|f| avatar.measure(f)).collect();
            let [a, b] = [&ends[0], &ends[1]];
            println!(
                "  {name:<12} height {:.3}..{:.3}  mass {:.1}..{:.1}  chest {:.3}..{:.3}  waist {:.3}..{:.3}  hip {:.3}..{:.3}",
                a.height,
                b.height,
                a.mass,
                b.mass,
                a.chest,
                b.chest,
                a.waist,
                b.waist,
                a.hip,
                b.hip
            );
        }
    }
    Ok(())
}
