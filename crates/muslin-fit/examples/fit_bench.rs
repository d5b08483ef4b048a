//! How long the fit takes: `cargo run --release -p muslin-fit --example fit_bench [PHOTO]`.
//!
//! Prints CPU time of this thread, the least mean of ten batches, and ends in an assertion.

use muslin_body::Avatar;
use muslin_fit::detect::{Models, find_people};
use muslin_fit::solve::{Fit, FitOptions, Fitter};
use muslin_io::{PhotoLimits, pose_graphs, read_photo};
use std::path::PathBuf;

/// The scheduler counts CPU time in steps of some milliseconds, so a batch is much longer.
const BATCH: u32 = 40;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let walk = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../assets/examples/walk.jpg"
    );
    let photo = PathBuf::from(std::env::args().nth(1).unwrap_or(walk.into()));
    let image = read_photo(&photo, &PhotoLimits::default())?.image;
    let graphs = pose_graphs()?;
    let found = find_people(&Models::new(&graphs.detector, &graphs.landmarks)?, &image);
    let person = found.people.first().ok_or("nobody in the picture")?;
    let avatar = Avatar::embedded()?;
    let fitter = Fitter::new(&avatar)?;
    let mut plane = person.keypoints.clone();
    plane.world = None;
    for (name, keypoints) in [
        ("2D and 3D points", &person.keypoints),
        ("2D points alone", &plane),
    ] {
        for (given, height_m, weight_kg) in [
            ("no height", None, None),
            ("height given", Some(1.72), None),
            ("height and mass given", Some(1.72), Some(66.0)),
        ] {
            let options = FitOptions {
                height_m,
                weight_kg,
                ..FitOptions::default()
            };
            let (fit, ms) = least(|| fitter.fit(keypoints, &options))?;
            let Fit {
                iterations,
                reprojection_px,
                ..
            } = fit;
            println!(
                "{name}, {given}: {ms:.2} ms CPU, {iterations} steps, {reprojection_px:.1} px"
            );
            assert!(reprojection_px < 0.05 * f64::from(keypoints.image_size[1]));
        }
    }
    Ok(())
}

/// The last result and the least mean CPU time of ten batches [ms].
fn least<E>(run: impl Fn() -> Result<Fit, E>) -> Result<(Fit, f64), E> {
    let mut least = f64::INFINITY;
    let mut last = run()?;
    for _ in 0..10 {
        let start = cpu_ms();
        for _ in 0..BATCH {
            last = run()?;
        }
        least = least.min((cpu_ms() - start) / f64::from(BATCH));
    }
    Ok((last, least))
}

/// CPU time of this thread where Linux tells it, else time on the wall [ms].
fn cpu_ms() -> f64 {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let first = told.and_then(|s| s.split(' ').next()?.parse::<f64>().ok());
    let wall = || {
        std::time::SystemTime::UNIX_EPOCH
            .elapsed()
            .map_or(0.0, |d| d.as_secs_f64() * 1e3)
    };
    first.map_or_else(wall, |ns| ns * 1e-6)
}
