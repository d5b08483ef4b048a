//! A frame takes no memory.

// An allocator that counts is made of one that does not.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

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
    let mut turns = vec![[0.0, 0.0, 0.0, 1.0]; playing.avatar().rig().n_bones()];
    let mut at = vec![[0.0; 3]; playing.n_verts()];
    assert!(playing.frame(&turns, [0.0; 3], &mut at), "the first may");
    let before = TAKEN.with(Cell::get);
    assert!(before > 1000, "it counts");
    for k in 0..10 {
        assert!(playing.frame(&turns, [0.1 * k as f32, 0.0, 0.0], &mut at));
    }
    assert_eq!(TAKEN.with(Cell::get), before);

    let was = at.clone();
    assert!(!playing.frame(&turns, [f32::NAN, 0.0, 0.0], &mut at));
    turns[7] = [0.0; 4];
    assert!(!playing.frame(&turns, [0.0; 3], &mut at));
    assert_eq!(at, was);
}
