//! How much memory a garment takes that is played, all that it keeps of its wearer included.

// An allocator that counts is made of one that does not.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicIsize, Ordering};

use muslin::{DressOptions, Playing, Wear};

struct Counting;

/// Bytes taken and not given back, and the most that they were.
static LIVE: AtomicIsize = AtomicIsize::new(0);
static MOST: AtomicIsize = AtomicIsize::new(0);

// SAFETY: all is left to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let size = layout.size() as isize;
        let live = LIVE.fetch_add(size, Ordering::Relaxed) + size;
        MOST.fetch_max(live, Ordering::Relaxed);
        // SAFETY: as the caller says.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size() as isize, Ordering::Relaxed);
        // SAFETY: as the caller says.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// What a garment may take while it is played [MB].
const MOST_MB: f64 = 64.0;

#[test]
fn garments_of_the_wardrobe_play_in_little_memory() {
    let megabytes = |bytes: isize| bytes as f64 / 1e6;
    for garment in ["tee", "long-sleeve", "trousers", "shorts", "skirt", "dress"] {
        let before = LIVE.load(Ordering::Relaxed);
        MOST.store(before, Ordering::Relaxed);
        let options = DressOptions {
            outfit: vec![Wear::parse(garment)],
            ..DressOptions::default()
        };
        let mut playing = Playing::new(None, &options).expect("a garment of the wardrobe");
        let opening = megabytes(MOST.load(Ordering::Relaxed) - before);
        MOST.store(LIVE.load(Ordering::Relaxed), Ordering::Relaxed);
        let turns = vec![[0.0, 0.0, 0.0, 1.0]; playing.bones().len()];
        for _ in 0..3 {
            assert!(playing.frame_with_normals(&turns, [0.0; 3]).is_some());
        }
        let played = megabytes(MOST.load(Ordering::Relaxed) - before);
        println!(
            "{garment}, {} vertices: {played:.1} MB played, {opening:.1} MB at most while it is opened",
            playing.n_verts()
        );
        assert!(played > 1.0 && played <= MOST_MB, "{garment}: {played} MB");
    }
}
