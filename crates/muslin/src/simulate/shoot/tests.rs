//! A stopped simulation goes on to the same bits.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

use muslin_body::Avatar;

use super::*;
use crate::options::DressOptions;
use crate::simulate::SimulateOptions;

/// A file in a folder of its own, removed in the end.
struct Place(PathBuf);

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.0.parent().expect("its folder"));
    }
}

fn place(name: &str) -> Place {
    let folder = format!("muslin-shoot-{}-{name}", std::process::id());
    let folder = std::env::temp_dir().join(folder);
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    Place(folder.join("job.part"))
}

fn set(avatar: &Avatar, frames: usize) -> Set<'_> {
    let options = SimulateOptions {
        motion: "wave".into(),
        fps: 30.0,
        seconds: Some(frames as f64 / 30.0),
        dress: DressOptions {
            edge: 0.025,
            ..SimulateOptions::default().dress
        },
        ..SimulateOptions::default()
    };
    Set::asked(avatar, &options)
}

/// Simulates until `stop` frames are there.
fn stopped(set: &Set, part: &std::path::Path, stop: usize) -> Failure {
    let flag = AtomicUsize::new(0);
    let until = format!("frame {stop} of");
    let mut watch = Watch::nobody()
        .stopping_at(&flag)
        .following(|text| flag.store(2 * usize::from(text.starts_with(&until)), Ordering::Relaxed));
    shoot(set, Some((part, false)), &mut watch).expect_err("it was stopped")
}

#[test]
fn a_stopped_simulation_goes_on_to_the_same_bits() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let set = set(&avatar, 40);
    let (whole, part) = (place("whole"), place("part"));
    let want = shoot(&set, Some((&whole.0, false)), &mut Watch::nobody()).expect("it simulates");
    let fault = stopped(&set, &part.0, 35);
    assert_eq!(fault.exit, Exit::Interrupted);
    assert!(
        fault.what.contains("30 of 40 frames") && fault.hint.contains("--resume"),
        "{fault}"
    );
    let got = shoot(&set, Some((&part.0, true)), &mut Watch::nobody()).expect("it goes on");
    assert_eq!(got.len(), 40);
    for (k, (a, b)) in got.cloth.iter().zip(&want.cloth).enumerate() {
        assert!(a == b, "cloth of frame {k} differs");
    }
    assert!(got.body == want.body, "the skin differs");
    // Everything is there now: nothing is simulated again.
    assert!(shoot(&set, Some((&part.0, true)), &mut Watch::nobody()).expect("there") == got);
    assert_eq!(got.again, 0);
    mended(set, got);
}

/// A frame that meets the body is reached once more, from the one before it, and no other; where the solver gives up,
/// as in cloth that is far too tight, it stays as it was.
fn mended(mut set: Set, whole: Reel) {
    let (part, k) = (place("mended"), 20);
    let mut torn = whole.clone();
    let aside = |x: &mut glam::DVec3| x.z = f64::from((x.z - 0.03) as f32);
    torn.cloth[k].iter_mut().for_each(aside);
    torn.told[k].body_intersections = 90.0;
    let reached = |set: &Set| {
        let mut journal = Journal::create(&part.0, head(set).as_bytes()).expect("writable");
        journal.append(&torn.record(0, None)).expect("writable");
        drop(journal);
        shoot(set, Some((&part.0, true)), &mut Watch::nobody()).expect("it is there")
    };
    let got = reached(&set);
    assert_eq!(got.again, 1);
    assert_eq!(got.told[k].body_intersections, 0.0);
    for (i, (a, b)) in got.cloth.iter().zip(&whole.cloth).enumerate() {
        assert!(i == k || a == b, "frame {i} was clean");
    }
    let off = got.cloth[k].iter().zip(&whole.cloth[k]);
    let off = off.map(|(a, b)| a.distance(*b)).sum::<f64>() / whole.cloth[k].len() as f64;
    assert!(off < 0.015, "{off} m from where it was before it was torn");
    let rest = set.cloth.rest.iter_mut().flatten();
    rest.for_each(|p| *p *= 0.4);
    let got = reached(&set);
    assert!(got.again == 0 && got.cloth[k] == torn.cloth[k]);
}

#[test]
fn a_simulation_stops_on_the_way_into_the_motion_too() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let (set, part, flag) = (set(&avatar, 3), place("early"), AtomicUsize::new(15));
    let mut watch = Watch::nobody().stopping_at(&flag);
    let fault = shoot(&set, Some((&part.0, false)), &mut watch).expect_err("it was stopped");
    assert_eq!(fault.exit, Exit::Terminated);
    assert!(fault.what.contains("nothing was written") && !part.0.exists());
}

#[test]
fn other_inputs_are_refused_by_name() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let mut set = set(&avatar, 40);
    let part = place("other");
    let head = head(&set);
    Journal::create(&part.0, head.as_bytes()).expect("writable");
    set.moving.motion.poses[20].root.x += 1e-9;
    set.cloth.materials[0].friction += 0.1;
    let fault = shoot(&set, Some((&part.0, true)), &mut Watch::nobody()).expect_err("others");
    assert_eq!((fault.exit, fault.code), (Exit::Invalid, "cannot-resume"));
    assert!(
        fault.what.contains("another motion and another clothes"),
        "{fault}"
    );
    set.air.wind.y += 0.1;
    let fault = shoot(&set, Some((&part.0, true)), &mut Watch::nobody()).expect_err("others");
    assert!(fault.what.contains("another air"), "{fault}");
}

#[test]
fn damage_is_refused_and_nothing_to_resume_is_a_start() {
    let avatar = Avatar::embedded().expect("the embedded body");
    let set = set(&avatar, 1);
    let part = place("damage");
    let mut journal = Journal::create(&part.0, head(&set).as_bytes()).expect("writable");
    for resume in [true, false] {
        let fault = shoot(&set, Some((&part.0, resume)), &mut Watch::nobody());
        assert_eq!(fault.expect_err("another job writes it").exit, Exit::Busy);
    }
    drop(journal);
    // Killed before the first frames were kept.
    assert!(Take::resume(&set, &part.0, &mut Watch::nobody()).is_ok());
    let open = Journal::open(&part.0).expect("readable");
    journal = open.expect("it is there");
    journal.append(&[1, 2, 3]).expect("writable");
    drop(journal);
    let fault = shoot(&set, Some((&part.0, true)), &mut Watch::nobody()).expect_err("damaged");
    assert_eq!(fault.code, "cannot-resume");
    std::fs::remove_file(&part.0).expect("removable");
    let mut warned = 0;
    let mut watch = Watch::new(|_| {}, |_| warned += 1);
    assert_eq!(
        shoot(&set, Some((&part.0, true)), &mut watch)
            .expect("it starts")
            .len(),
        1
    );
    drop(watch);
    assert_eq!(warned, 1);
}
