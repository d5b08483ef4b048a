//! A frame takes no memory.

// An allocator that counts is made of one that does not.
#![allow(unsafe_code)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::Hero;
use muslin::{DressOptions, Playing, Wear};

struct Counting;

thread_local! {
    static TAKEN: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: all is left to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = TAKEN.try_with(|n| n.set(n.get() + 1));
        // SAFETY: as the caller says.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller says.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn frames_take_no_memory_and_refuse_what_is_not_finite() {
    let options = DressOptions {
        outfit: vec![Wear::parse("tee")],
        ..DressOptions::default()
    };
    let mut playing = Playing::new(None, &options).expect("a garment of the wardrobe");
    let mut turns = vec![[0.0, 0.0, 0.0, 1.0]; playing.bones().len()];
    assert!(playing.frame(&turns, [0.0; 3]).is_some(), "the first may");
    let before = TAKEN.with(Cell::get);
    assert!(before > 1000, "it counts");
    let (sin, cos) = 0.1f32.sin_cos();
    for k in 0..10 {
        turns[20] = [0.0, sin, 0.0, cos];
        let root = [0.1 * k as f32, 0.0, 0.0];
        assert!(playing.frame(&turns, root).is_some());
        let [_, normals] = playing
            .frame_with_normals(&turns, root)
            .expect("it may again");
        let long = |n: &[f32; 3]| n.iter().map(|x| x * x).sum::<f32>().sqrt();
        assert!(normals.iter().all(|n| (long(n) - 1.0).abs() < 1e-5));
    }
    assert_eq!(TAKEN.with(Cell::get), before);

    assert!(playing.frame(&turns, [f32::NAN, 0.0, 0.0]).is_none());
    // What is finite and still too much gives nothing rather than cloth that is nowhere.
    playing.begin(f64::INFINITY);
    playing.set_motion_level(f32::INFINITY);
    let leaps = (0..6).map(|k| [3e38 * (k % 2) as f32, 0.0, 0.0]);
    for root in leaps {
        if let Some(at) = playing.frame(&turns, root) {
            assert!(at.as_flattened().iter().all(|x| x.is_finite()));
        }
    }
    let mut none = turns.clone();
    none[7] = [0.0; 4];
    assert!(playing.frame(&none, [0.0; 3]).is_none());
    let calm = playing.frame(&turns, [0.0; 3]).expect("it begins anew");
    assert!(calm.iter().all(|p| p[1].abs() < 2.0));
}

#[test]
fn frames_on_a_character_take_no_memory_and_refuse_what_is_no_place() {
    let hero = Hero::new("memory");
    let mut playing = Playing::new(None, &hero.options()).expect("a garment on a character");
    let mut joints = playing.character_bound().to_vec();
    assert!(joints.len() > 20 && playing.character_joints().len() == joints.len());
    let first = playing.frame_on(&joints).expect("as it was bound").to_vec();
    let before = TAKEN.with(Cell::get);
    for k in 0..5 {
        joints.iter_mut().for_each(|m| m[14] += 0.01 * k as f32);
        assert!(playing.frame_on_with_normals(&joints).is_some());
    }
    assert_eq!(TAKEN.with(Cell::get), before);
    // All of it went along, ten centimetres to the front.
    playing.begin(0.1);
    let gone = playing.frame_on(&joints).expect("sound");
    for (a, b) in first.iter().zip(gone) {
        assert!(
            (b[2] - a[2] - 0.1).abs() < 1e-3 && (b[1] - a[1]).abs() < 1e-3,
            "{a:?} {b:?}"
        );
    }
    for broken in [f32::NAN, 3e38] {
        let mut broke = joints.clone();
        broke[3] = [broken; 16];
        assert!(playing.frame_on(&broke).is_none());
    }
    let mut flat = joints.clone();
    flat[3] = [0.0; 16];
    assert!(playing.frame_on(&flat).is_none());
    assert!(playing.frame_on(&joints).is_some());
    // What leads no bone of ours may be hidden by scaling it to nothing.
    let hidden = |k: usize| {
        let mut hidden = joints.clone();
        hidden[k] = [0.0; 16];
        hidden
    };
    let all = (0..joints.len()).map(hidden);
    let taken: Vec<bool> = all.map(|j| playing.frame_on(&j).is_some()).collect();
    assert!(taken.contains(&true) && taken.contains(&false), "{taken:?}");
    // Frames by turns know nothing of joints that moved apart before.
    let turns = vec![[0.0, 0.0, 0.0, 1.0]; playing.bones().len()];
    playing.begin(0.1);
    let calm = playing.frame(&turns, [0.0; 3]).expect("sound").to_vec();
    let mut apart = joints.clone();
    apart
        .iter_mut()
        .enumerate()
        .for_each(|(k, m)| m[12] += 0.004 * k as f32);
    playing.begin(0.1);
    playing.frame_on(&apart).expect("sound");
    playing.begin(0.1);
    let again = playing.frame(&turns, [0.0; 3]).expect("sound");
    assert_eq!(calm.first(), again.first());
    // The least step that the header names is one.
    playing.begin(f64::from(1e-4f32));
    let ours = DressOptions {
        outfit: vec![Wear::parse("tee")],
        ..DressOptions::default()
    };
    let mut ours = Playing::new(None, &ours).expect("a garment of the wardrobe");
    assert!(ours.character_joints().is_empty() && ours.frame_on(&[]).is_none());
}

#[test]
fn models_of_other_cloth_or_of_files_are_refused() {
    let folder = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../assets/wardrobe/tee.muslin"
    );
    let bytes = std::fs::read(folder).expect("the wardrobe");
    let open = |bytes: &[u8]| match Playing::new(Some(bytes), &DressOptions::default()) {
        Ok(_) => String::new(),
        Err(e) => e.to_string(),
    };
    assert_eq!(open(&bytes), "");
    let changed = |from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes());
        let mut other = bytes.clone();
        let at = at.expect("a note");
        other[at..at + to.len()].copy_from_slice(to.as_bytes());
        open(&other)
    };
    let file = changed("\"garment\":\"tee\"", "\"garment\":\"a/b\"");
    assert!(file.contains("from a file"), "{file}");
    let hero = changed("\"body\":\"anny\"", "\"body\":\"hero\"");
    assert!(hero.contains("taught on a character"), "{hero}");
    let skirt = changed("\"edge\":\"0.012\"", "\"edge\":\"0.014\"");
    assert!(skirt.contains("other triangles"), "{skirt}");
    let none = changed("\"edge\":\"0.012\"", "\"edge\":\"0.000\"");
    assert!(none.contains("out of range"), "{none}");
}
