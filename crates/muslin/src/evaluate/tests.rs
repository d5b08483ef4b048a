use glam::{DVec2, DVec3};
use muslin_geom::{Drape, Part};

use super::*;

/// A flat sheet of 9 × 9 vertices, 5 cm apart, that falls freely at 30 frames a second.
fn falling(n: usize) -> Clip {
    let at = |i: usize| DVec2::new((i % 9) as f64, (i / 9) as f64) * 0.05;
    let mut faces = Vec::new();
    for i in (0..72u32).filter(|i| i % 9 < 8) {
        faces.extend([[i, i + 1, i + 9], [i + 1, i + 10, i + 9]]);
    }
    let frame = |t: usize| {
        let time = t as f64 / 30.0;
        let height = 2.0 - 0.5 * 9.81 * time * time;
        (0..81)
            .map(|i| DVec3::new(at(i).x, height, at(i).y))
            .collect()
    };
    let corners = faces
        .iter()
        .map(|f: &[u32; 3]| f.map(|i| at(i as usize)))
        .collect();
    Clip {
        drape: Drape {
            parts: vec![Part {
                name: "sheet".into(),
                verts: 0..81,
                faces: 0..faces.len(),
            }],
            faces,
            frames: (0..n).map(frame).collect(),
            fps: 30.0,
        },
        corners,
        ..Clip::default()
    }
}

/// A cube of half a metre around a place.
fn cube(middle: DVec3) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner =
        |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) - 0.5;
    let verts = (0..8).map(|i| middle + 0.5 * corner(i)).collect();
    let quads = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    let faces = quads
        .iter()
        .flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
        .collect();
    (verts, faces)
}

fn figure(e: &Evaluation, group: &str, name: &str) -> f64 {
    let Some(Value::Tree(tree)) = e.report.get(group) else {
        panic!("no group {group}")
    };
    match tree.get(name) {
        Some(Value::Number(x)) => *x,
        other => panic!("{group} {name} is {other:?}"),
    }
}

#[test]
fn a_sheet_in_free_fall_has_no_strain_no_force_and_the_acceleration_of_gravity() {
    let e = evaluate(&falling(8), None).expect("a sound clip");
    assert!(figure(&e, "energies", "strain_J") < 1e-20);
    assert!((figure(&e, "clip", "mass_kg") - 0.16 * 426.0 * 0.47e-3).abs() < 1e-9);
    assert!((figure(&e, "time", "acceleration_mean_m_s2") - 9.81).abs() < 1e-9);
    assert!(figure(&e, "time", "jerk_mean_m_s3") < 1e-6);
    assert_eq!(figure(&e, "self", "edge_triangle_crossings_max"), 0.0);
    let still = evaluate(&falling(1), None).expect("a still");
    // At rest in mid-air nothing carries it: the force is its weight.
    assert!(
        (figure(
            &still,
            "energies",
            "residual_force_per_weight_free_vertices"
        ) - 1.0)
            .abs()
            < 1e-9
    );
}

#[test]
fn a_stretched_and_folded_sheet_reads_as_it_was_made() {
    let mut clip = falling(1);
    for x in &mut clip.drape.frames[0] {
        x.x *= 1.1;
    }
    let e = evaluate(&clip, None).expect("a sound clip");
    assert!((figure(&e, "stretch", "edge_max") - 0.1).abs() < 1e-6);
    assert!((figure(&e, "stretch", "principal_max") - 1.1).abs() < 1e-6);
    assert!((figure(&e, "stretch", "area_change_mean") - 0.1).abs() < 1e-9);
    // ½ (λ + 2 μ) E² A with Green's strain E = (1.21 − 1)/2.
    let (mu, lambda) = (0.5 * 7e4 / 1.485, 7e4 * 0.485 / (1.0 - 0.485 * 0.485));
    let want = 0.5 * (lambda + 2.0 * mu) * 0.47e-3 * 0.105f64.powi(2) * 0.16;
    assert!((figure(&e, "energies", "strain_J") / want - 1.0).abs() < 1e-9);
    for x in &mut clip.drape.frames[0] {
        x.x /= 1.1;
        if x.x > 0.201 {
            *x = DVec3::new(0.2, x.y + x.x - 0.2, x.z);
        }
    }
    let e = evaluate(&clip, None).expect("a sound clip");
    assert!(
        figure(&e, "shape", "fold_change_mean_deg") > 3.0
            && figure(&e, "energies", "strain_J") < 1e-12
    );
}

#[test]
fn a_body_inside_and_one_passed_through_are_found() {
    let mut clip = falling(2);
    let (verts, faces) = cube(DVec3::new(0.2, 1.9, 0.2));
    clip.body_faces = faces;
    clip.body = vec![verts.clone(), verts];
    let e = evaluate(&clip, None).expect("a sound clip");
    // The sheet lies 10 cm above the cube's middle: 15 cm from its
    // top, from 5 cm to 25 cm from its sides.
    assert!(figure(&e, "contact", "penetrating_percent") > 99.0);
    assert!((figure(&e, "contact", "depth_max_mm") - 150.0).abs() < 6.0);
    let mut clip = falling(2);
    let (verts, faces) = cube(DVec3::new(0.2, 1.4, 0.2));
    let up = verts.iter().map(|v| *v + DVec3::Y * 1.5).collect();
    (clip.body, clip.body_faces) = (vec![verts, up], faces);
    let e = evaluate(&clip, None).expect("a sound clip");
    assert_eq!(figure(&e, "contact", "penetrating_percent"), 0.0);
    assert!(figure(&e, "contact", "passages_between_frames") >= 81.0);
}

#[test]
fn cloth_that_is_through_cloth_at_the_next_frame_is_seen_though_neither_frame_crosses() {
    // A second sheet, half a cell off, above the first by so much in either of two frames.
    let pair = |above: [f64; 2]| {
        let mut clip = falling(2);
        let more: Vec<[u32; 3]> = clip.drape.faces.iter().map(|f| f.map(|i| i + 81)).collect();
        clip.drape.faces.extend(more);
        clip.corners.extend_from_within(..);
        for (x, above) in clip.drape.frames.iter_mut().zip(above) {
            let off = DVec3::new(0.012, above, 0.007);
            let more: Vec<DVec3> = x.iter().map(|p| *p + off).collect();
            x.extend(more);
        }
        clip.drape.parts[0].verts = 0..162;
        clip.drape.parts[0].faces = 0..clip.drape.faces.len();
        let e = evaluate(&clip, None).expect("a sound clip");
        ["frames_with_crossings", "passages_between_frames"].map(|f| figure(&e, "self", f))
    };
    assert_eq!(pair([0.01, 0.002]), [0.0, 0.0]);
    let [crossing, passages] = pair([0.01, -0.01]);
    // 64 vertices of either sheet are over or under the other.
    assert_eq!((crossing, passages), (0.0, 128.0));
}

#[test]
fn crossings_are_counted_and_non_finite_frames_left_out() {
    let mut clip = falling(3);
    clip.drape.frames[1][40].y = f64::NAN;
    // A corner pushed down through the sheet beside it.
    for (k, frame) in clip.drape.frames.iter_mut().enumerate() {
        if k != 1 {
            frame[0] = frame[20] + DVec3::new(0.011, -0.05, 0.013);
            frame[1].y += 0.05;
        }
    }
    let e = evaluate(&clip, None).expect("two sound frames");
    assert_eq!(figure(&e, "clip", "non_finite_frames"), 1.0);
    assert_eq!(figure(&e, "clip", "non_finite_values"), 1.0);
    assert!(figure(&e, "self", "edge_triangle_crossings_a_frame") >= 1.0);
    assert!(e.table().contains("edge triangle crossings a frame"));
    clip.drape.frames.iter_mut().for_each(|f| f[0].x = f64::NAN);
    assert!(evaluate(&clip, None).is_err());
}

#[test]
fn against_itself_there_is_no_gap() {
    let clip = falling(4);
    let e = evaluate(&clip, Some(&clip)).expect("a sound clip");
    assert_eq!(figure(&e, "against", "energy_gap_J"), 0.0);
    assert_eq!(figure(&e, "against", "distance_p95_mm"), 0.0);
    assert!(evaluate(&clip, Some(&falling(3))).is_err());
}

#[test]
fn what_cloth_does_beyond_a_still_body_is_told_of_both_sides() {
    // Level cloth for eight frames that turns about; beyond it one goes up and down, the other twice as far and lies
    // aside throughout.
    let mut still = falling(8);
    let level = still.drape.frames[0].clone();
    for (t, x) in still.drape.frames.iter_mut().enumerate() {
        let turn = glam::DQuat::from_rotation_y(0.3 * t as f64);
        *x = level.iter().map(|p| turn * *p).collect();
    }
    let moved = |up: f64, aside: f64| {
        let mut clip = still.clone();
        for (t, x) in clip.drape.frames.iter_mut().enumerate() {
            let sign = if t % 2 == 0 { up } else { -up };
            let turn = glam::DQuat::from_rotation_y(0.3 * t as f64);
            let off = turn * (DVec3::X * aside) + DVec3::Y * sign;
            x.iter_mut().for_each(|p| *p += off);
        }
        clip
    };
    let (clip, other) = (moved(0.003, 0.0), moved(0.006, 0.008));
    let without = Still::of(&clip, still).expect("the same cloth");
    let still = Some(&without);
    let e = judge(&clip, still, |cloth, frames| {
        compare((&clip, still), (&other, Report::default()), cloth, frames).map(Some)
    });
    let e = e.expect("a sound clip");
    for (group, name, want) in [
        ("time", "dynamic_content_mm", 3.0),
        ("time", "swing_mm", 3.0),
        ("against", "their_dynamic_content_mm", 10.0),
        ("against", "their_swing_mm", 6.0),
        ("against", "dynamic_content_of_theirs", 0.3),
        ("against", "swing_of_theirs", 0.5),
    ] {
        let got = figure(&e, group, name);
        assert!((got - want).abs() < 1e-6, "{name}: {got} for {want}");
    }
    let shorter = Still::of(&clip, falling(7)).err().expect("other frames");
    assert_eq!(shorter.code, "not-the-same-cloth");
}

#[test]
fn the_frames_tell_over_time_what_the_report_tells_of_all() {
    let e = evaluate(&falling(6), None).expect("a sound clip");
    let mut lines = e.frames.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let names = lines.next().expect("a head");
    let lines: Vec<_> = lines.collect();
    assert_eq!(lines.len(), 6);
    assert!(lines.iter().all(|l| l.len() == names.len()));
    let at = |name: &str| names.iter().position(|n| *n == name).expect("a column");
    let column = |name: &str| -> Vec<Option<f64>> {
        lines.iter().map(|l| l[at(name)].parse().ok()).collect()
    };
    let gravity: Vec<f64> = column("gravity_J").into_iter().flatten().collect();
    let (mean, told) = (
        gravity.iter().sum::<f64>() / 6.0,
        figure(&e, "energies", "gravity_J"),
    );
    assert!((mean - told).abs() < 1e-12 * told.abs(), "{mean} {told}");
    // What falls loses height and nothing else: m g h with h = ½ g t².
    let mass = figure(&e, "clip", "mass_kg");
    let lost = 0.5 * 9.81 * 9.81 * mass * column("time_s")[5].expect("a time").powi(2);
    assert!((gravity[0] - gravity[5] - lost).abs() < 1e-3 * lost);
    assert_eq!(column("inertia_J").iter().flatten().count(), 4);
    assert_eq!(column("vertices_inside"), [Some(0.0); 6]);
}

#[test]
fn frames_that_are_no_numbers_say_nothing_of_drift() {
    let mut still = held(5);
    still.drape.frames[4].iter_mut().for_each(|x| x.y += 0.001);
    let name = "drift_on_still_body_mm_10s";
    let drift = |clip: &Clip| {
        let e = evaluate(clip, None).expect("a sound frame");
        let told = muslin_io::report_json(&e.report).contains(name);
        told.then(|| figure(&e, "time", name))
    };
    let whole = drift(&still).expect("the body is still");
    let mut broken = still.clone();
    broken.drape.frames[0][7].x = f64::NAN;
    // As far in three steps as in four.
    let cut = drift(&broken).expect("the body is still");
    assert!(
        (3.0 * cut / (4.0 * whole) - 1.0).abs() < 1e-3,
        "{cut} {whole}"
    );
    // A body that walks is no still one because its first frame is none.
    let mut walks = still.clone();
    for (t, body) in walks.body.iter_mut().enumerate() {
        body.iter_mut().for_each(|x| x.z += 0.1 * t as f64);
    }
    walks.body[0][0].x = f64::NAN;
    assert_eq!(drift(&walks), None);
}

/// The sheet, level in mid-air, held along one side by a cube beside it, for `n` frames.
fn held(n: usize) -> Clip {
    let mut clip = falling(n);
    let level = clip.drape.frames[0].clone();
    clip.drape.frames.fill(level);
    let (verts, faces) = cube(DVec3::new(-0.3, 2.0, 0.2));
    (clip.body, clip.body_faces) = (vec![verts; n], faces);
    clip.pins = (0..81).step_by(9).collect();
    clip
}

fn minimised(clip: &Clip) -> Evaluation {
    let solver = Solver::new(clip, None).expect("a body");
    let told = |cloth: &Reference, _: &[Frame]| {
        let told = solver.minimised(None, (cloth, &mut Watch::nobody()));
        told.map(Some)
    };
    judge(clip, None, told).expect("a sound clip")
}

#[test]
fn the_minimiser_lets_a_sheet_hang_and_leaves_one_that_hangs() {
    let mut clip = held(2);
    let e = minimised(&clip);
    let (gap, weight) = (
        figure(&e, "against", "energy_gap_J"),
        figure(&e, "against", "gap_of_weight_J"),
    );
    // Held at one side it hangs straight down, its middle 20 cm lower.
    let want = 0.16 * 0.2 * 9.81 * 0.2;
    assert!((weight / want - 1.0).abs() < 0.05, "{weight} J, {want} J");
    assert!((gap / want - 1.0).abs() < 0.05, "{gap} J, {want} J");
    assert!(figure(&e, "against", "distance_mean_mm") > 200.0);
    assert_eq!(figure(&e, "against", "frames"), 2.0);
    let solver = Solver::new(&clip, None).expect("a body");
    let hung = solver.at_rest(0, &|| true).expect("it hangs");
    clip.drape.frames = vec![hung.verts; 2];
    let e = minimised(&clip);
    let left = figure(&e, "against", "energy_gap_J");
    // It is held where it lies now, and sinks as far below that again as it weighs.
    assert!(left.abs() < 0.02 * want, "{left} J");
    assert!(figure(&e, "against", "distance_p95_mm") < 10.0);
}

#[test]
fn the_simulator_goes_its_own_way_from_where_the_first_frame_comes_to_rest() {
    let clip = held(4);
    let solver = Solver::new(&clip, Some("denim")).expect("a body");
    let hung = solver.simulated(&mut Watch::nobody()).expect("two frames");
    assert_eq!(hung.drape.frames.len(), 4);
    let low = |x: &[DVec3]| x.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    for x in &hung.drape.frames {
        assert!((1.58..1.63).contains(&low(x)), "{}", low(x));
    }
    let e = evaluate(&clip, Some(&hung)).expect("the same cloth");
    assert!(figure(&e, "against", "energy_gap_J") > 0.0);
    assert_eq!(
        solver.told("simulator").get("fabric"),
        Some(&Value::Text("denim".into()))
    );
}

#[test]
fn what_the_solver_cannot_do_is_said() {
    let code = |clip: &Clip, fabric: Option<&str>| {
        let simulated = Solver::new(clip, fabric).and_then(|s| s.simulated(&mut Watch::nobody()));
        let fault = simulated.expect_err("not possible");
        (fault.code, fault.exit)
    };
    assert_eq!(code(&falling(4), None), ("no-body", Exit::Invalid));
    assert_eq!(code(&held(1), None), ("one-frame", Exit::Invalid));
    assert_eq!(
        code(&held(2), Some("cheese")),
        ("unknown-fabric", Exit::Usage)
    );
    let mut named = held(2);
    named.fabrics = vec!["cheese".into()];
    assert_eq!(code(&named, None), ("unknown-fabric", Exit::Invalid));
    let mut hole = held(3);
    hole.body[1][0].x = f64::NAN;
    assert_eq!(code(&hole, None), ("not-finite", Exit::Invalid));
}

#[test]
fn results_never_replace_what_is_read_or_each_other() {
    let taken = |out: &str, frames: Option<&str>| {
        let options = EvaluateOptions {
            against: Some(Against::File("b.npz".into())),
            still: Some("c.npz".into()),
            frames: frames.map(PathBuf::from),
            ..EvaluateOptions::default()
        };
        let told = kept_apart((Path::new("a.npz"), &options), Path::new(out));
        told.err().map(|f| (f.exit, f.place))
    };
    assert_eq!(taken("a.json", Some("a.csv")), None);
    for read in ["a.npz", "./b.npz", "c.npz"] {
        assert_eq!(
            taken(read, None),
            Some((Exit::Usage, "--out".into())),
            "{read}"
        );
        let frames = taken("a.json", Some(read));
        assert_eq!(frames, Some((Exit::Usage, "--frames".into())), "{read}");
    }
    let twice = taken("a.json", Some("a.json"));
    assert_eq!(twice, Some((Exit::Usage, "--frames".into())));
}

#[test]
fn another_rate_is_another_motion_and_frames_that_nobody_knows_the_speed_of_are_left_out_of_a_gap()
{
    let clip = falling(6);
    let mut faster = clip.clone();
    faster.drape.fps *= 4.0;
    let fault = evaluate(&clip, Some(&faster)).expect_err("another rate");
    assert!(fault.what.contains("frames a second"), "{fault}");
    let mut hole = clip.clone();
    hole.drape.frames[2][0].x = f64::NAN;
    let told = evaluate(&clip, Some(&hole)).expect("the same otherwise");
    assert_eq!(told.figure("against", "energy_gap_J"), 0.0);
}

#[test]
fn cloth_in_millimetres_is_remarked_on() {
    let mut clip = falling(2);
    assert_eq!(size(&clip), None);
    let all = clip.drape.frames.iter_mut().flatten();
    all.for_each(|x| *x *= 1000.0);
    assert!(size(&clip).is_some_and(|w| w.contains("metres")));
}
