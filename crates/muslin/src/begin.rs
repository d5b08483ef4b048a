//! Where trained garments begin that are not clean in a pose: on the way to it, as far as they are.

use glam::DVec3;
use muslin_geom::{Mesh, Surface, self_intersections};
use rayon::prelude::*;

/// Pairs of triangles that cross, and vertices lost in the body, that there may be in what a garment was taught; with
/// more it knows nothing of the pose.
const MANY: usize = 60;
/// So few come free without a trace.
const FEW: usize = 12;
/// Deeper in the body than this a vertex may come out on the far side of a limb [m]; and how deep is looked.
const LOST: [f64; 2] = [0.015, 0.1];
/// Shares of the way from the rest pose at which trained garments are asked, until little enough is wrong: what
/// crosses itself in the pose itself, as legs do in a long step, may not yet do so before.
const SHARES: [f64; 5] = [1.0, 0.85, 0.7, 0.55, 0.4];

/// The share of the way to a pose at which garments of these triangles begin, and where they lie there [m]: the
/// first with next to nothing wrong, or that with the least; nothing if they know nothing of the way.
///
/// `at` says of a share where the networks lay the cloth [m], and the skin there.
pub(crate) fn begin(
    faces: &[[u32; 3]],
    at: impl Fn(f64) -> Option<(Vec<DVec3>, Surface)> + Sync,
) -> Option<(f64, Vec<DVec3>)> {
    let look = |share: &f64| {
        let (verts, skin) = at(*share)?;
        let faces = faces.to_vec();
        let mesh = Mesh { verts, faces };
        let wrong = self_intersections(&mesh).len() + lost(&skin, &mesh.verts);
        Some((wrong, *share, mesh.verts))
    };
    let mut least: Option<(usize, f64, Vec<DVec3>)> = None;
    // Much of a look is one thread's work, so the next is taken at the same time.
    'all: for shares in SHARES.chunks(2) {
        let seen: Vec<_> = shares.par_iter().map(look).collect();
        for one in seen {
            let one = one?;
            let wrong = one.0;
            if least.as_ref().is_none_or(|l| wrong < l.0) {
                least = Some(one);
            }
            if wrong <= FEW {
                break 'all;
            }
        }
    }
    let (wrong, share, verts) = least?;
    (wrong <= MANY).then_some((share, verts))
}

/// How many vertices of the cloth at `x` [m] lie deep in a body.
fn lost(skin: &Surface, x: &[DVec3]) -> usize {
    let [depth, far] = LOST;
    let is_lost = |p: &&DVec3| {
        skin.closest(**p, far)
            .is_some_and(|hit| hit.signed < -depth)
    };
    x.par_iter().filter(is_lost).count()
}
