//! Reading the landmark network: points sharpened by heat maps, back in the picture and in space.

use glam::{DVec2, DVec3};
use muslin_body::{Keypoint, Keypoints, Layout};

use super::crop::Square;

/// Shapes of the outputs used: points, presence, heat maps, points in space.
pub(super) const OUTPUTS: [&[usize]; 4] = [&[1, 195], &[1, 1], &[1, MAP, MAP, N_ALL], &[1, 117]];
/// Points the network gives; the last six only serve tracking.
const N_ALL: usize = 39;
/// Points of a person.
const N: usize = 33;
/// Cells along a side of a heat map.
const MAP: usize = 64;
/// Pixels along a side of the network's picture; its points are in these.
const SIDE: f64 = 256.0;
/// Cells looked at to every side of a point.
const REACH: usize = 4;
/// Least peak of a heat map that may move a point.
const LEAST_PEAK: f64 = 0.5;

/// The points of the person in `square` of a picture of `size`.
///
/// `points` holds five numbers per point: place, depth, and the logits of being seen and of being
/// there; `space` holds three: metres to the picture's right, down and away, as the square is
/// turned.
pub(super) fn read(
    points: &[f32],
    maps: &[f32],
    space: &[f32],
    (square, size): (&Square, [u32; 2]),
) -> Keypoints {
    let rows = points.as_chunks::<5>().0.iter().take(N).enumerate();
    let found = rows.map(|(i, row)| {
        let coarse = DVec2::new(f64::from(row[0]), f64::from(row[1])) / SIDE;
        let pixel = square.to_picture(sharpen(coarse, i, maps));
        Keypoint {
            pixel,
            score: sigmoid(row[3]),
        }
    });
    let turn = DVec2::from_angle(square.angle);
    let world = space.as_chunks::<3>().0.iter().take(N).map(|row| {
        let [x, y, z] = row.map(f64::from);
        let p = turn.rotate(DVec2::new(x, y));
        DVec3::new(p.x, -p.y, -z)
    });
    Keypoints {
        layout: Layout::BlazePose33,
        points: found.collect(),
        world: Some(world.collect()),
        image_size: size,
    }
}

fn sigmoid(x: f32) -> f64 {
    1.0 / (1.0 + f64::from(-x).exp())
}

/// Where point `i`'s heat map has its weight, near `p`; `p` itself if the map is cold there.
///
/// Places are shares of the square.
fn sharpen(p: DVec2, i: usize, maps: &[f32]) -> DVec2 {
    let cell = p * MAP as f64;
    let inside = cell.cmpge(DVec2::ZERO).all() && cell.cmplt(DVec2::splat(MAP as f64)).all();
    if !inside {
        return p;
    }
    let window = |c: f64| (c as usize).saturating_sub(REACH)..(c as usize + REACH + 1).min(MAP);
    let (mut sum, mut peak, mut place) = (0.0, 0.0f64, DVec2::ZERO);
    for y in window(cell.y) {
        for x in window(cell.x) {
            let heat = sigmoid(maps[(y * MAP + x) * N_ALL + i]);
            sum += heat;
            peak = peak.max(heat);
            place += DVec2::new(x as f64, y as f64) * heat;
        }
    }
    if peak >= LEAST_PEAK {
        place / (sum * MAP as f64)
    } else {
        p
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cold() -> Vec<f32> {
        vec![-30.0; MAP * MAP * N_ALL]
    }

    #[test]
    fn a_warm_map_moves_a_point_and_a_cold_one_does_not() {
        let mut maps = cold();
        let p = DVec2::new(10.4, 20.9) / 64.0;
        assert_eq!(sharpen(p, 7, &maps), p);
        maps[(22 * MAP + 12) * N_ALL + 7] = 9.0;
        assert!((sharpen(p, 7, &maps) - DVec2::new(12.0, 22.0) / 64.0).length() < 1e-6);
        assert_eq!(sharpen(p, 6, &maps), p);
        // Five cells away is out of reach; outside the square nothing is looked at.
        assert_eq!(
            sharpen(DVec2::new(17.5, 22.0) / 64.0, 7, &maps),
            DVec2::new(17.5, 22.0) / 64.0
        );
        assert_eq!(
            sharpen(DVec2::new(-0.1, 0.3), 7, &maps),
            DVec2::new(-0.1, 0.3)
        );
    }

    #[test]
    fn points_turn_with_their_square() {
        let mut points = vec![0.0; N_ALL * 5];
        points[..5].copy_from_slice(&[256.0, 128.0, 0.0, 0.0, 0.0]);
        let mut space = vec![0.0; N_ALL * 3];
        space[..3].copy_from_slice(&[1.0, 2.0, 3.0]);
        let angle = std::f64::consts::FRAC_PI_2;
        let square = Square {
            centre: DVec2::new(10.0, 20.0),
            side: 8.0,
            angle,
        };
        let k = read(&points, &cold(), &space, (&square, [40, 30]));
        assert_eq!(k.points.len(), 33);
        assert!((k.points[0].pixel - DVec2::new(10.0, 24.0)).length() < 1e-12);
        assert_eq!(k.points[0].score, 0.5);
        let world = k.world.expect("there are points in space");
        assert!((world[0] - DVec3::new(-2.0, -1.0, -3.0)).length() < 1e-12);
    }
}
