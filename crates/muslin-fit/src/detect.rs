//! Who is in a picture, and where their joints are.
//!
//! Two networks after Bazarevsky et al. 2020 (BlazePose): one looks at the whole picture for
//! people, the other at an upright square around each for 33 points. What surrounds the networks
//! here — anchors, merging of boxes, the square, the reading of heat maps — follows MediaPipe
//! 0.10.14 to a fraction of a pixel, because the networks were trained with it.

mod boxes;
mod crop;
mod points;

use std::sync::{Mutex, MutexGuard, PoisonError};

use glam::DVec2;
use muslin_body::Keypoints;
use muslin_geom::Image;
use muslin_net::{Graph, Net, NetError, Scratch};

use boxes::Candidate;
pub use crop::Square;

/// Least certainty that a square holds a person, as in MediaPipe.
const LEAST_PRESENCE: f64 = 0.5;
/// Two people whose points are this near, as a share of their squares' side, are one.
const SAME: f64 = 0.08;

/// A picture so many times as long as it is wide is looked at in squares along it, too.
const LONG: f64 = 1.5;
/// Sides of the squares in which a picture is searched where nobody was found in it as a whole, as shares of its shorter side,
/// and the least of them [px].
const PARTS: [f64; 2] = [0.5, 0.25];
const SMALLEST: f64 = 200.0;

/// Somebody found in a part of a picture counts if the part shows so many of their points, and if no more of the smaller of two
/// boxes is shared with somebody else.
const WHOLE: f64 = 0.9;
const SHARED: f64 = 0.4;

/// The two networks, ready to run on any number of pictures.
pub struct Models {
    detector: Net,
    landmarks: Net,
    /// Room that searches have left behind, so that the next need not ask for it again.
    rooms: Mutex<Vec<Scratch>>,
}

/// Why networks cannot serve here.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// A network cannot run at all.
    #[error(transparent)]
    Net(#[from] NetError),
    /// A network is for something else.
    #[error("the {which} network maps {got}, not {want}: it is another model")]
    Shape {
        /// Which of the two.
        which: &'static str,
        /// Its inputs and outputs.
        got: String,
        /// What they should be.
        want: String,
    },
}

/// One person.
#[derive(Clone, Debug, PartialEq)]
pub struct Person {
    /// The 33 points, in the picture and in space. The score is the network's certainty that a
    /// point is seen.
    pub keypoints: Keypoints,
    /// The detector's score, 0.5 to 1.
    pub score: f64,
    /// The second network's certainty that there is a whole person, 0.5 to 1.
    pub presence: f64,
    /// The upright square the points were looked for in.
    pub square: Square,
    /// Least and greatest corner of the points [px]; they may lie outside the picture.
    pub bounds: [DVec2; 2],
}

/// What a picture holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Everybody, the largest first.
    pub people: Vec<Person>,
    /// The detector's best score anywhere, 0 to 1; below 0.5 it saw nobody.
    pub best_score: f64,
    /// The second network's best certainty, 0 to 1; zero if it was never asked.
    pub best_presence: f64,
}

impl Models {
    /// Prepares the pose detector and the full landmark network of MediaPipe 0.10.14.
    pub fn new(detector: &Graph, landmarks: &Graph) -> Result<Self, ModelError> {
        let models = Self {
            detector: Net::new(detector, &[0, 1])?,
            // Points, presence, heat maps, points in space; the mask (2) is not wanted.
            landmarks: Net::new(landmarks, &[0, 1, 3, 4])?,
            rooms: Mutex::default(),
        };
        shaped(
            "detector",
            &models.detector,
            &[&[1, 224, 224, 3]],
            &boxes::OUTPUTS,
        )?;
        shaped(
            "landmark",
            &models.landmarks,
            &[&[1, 256, 256, 3]],
            &points::OUTPUTS,
        )?;
        Ok(models)
    }

    fn rooms(&self) -> MutexGuard<'_, Vec<Scratch>> {
        self.rooms.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn shaped(
    which: &'static str,
    net: &Net,
    inputs: &[&[usize]],
    outputs: &[&[usize]],
) -> Result<(), ModelError> {
    let (want, got) = ((inputs, outputs), (net.input_shapes(), net.output_shapes()));
    if got.0 == want.0 && got.1 == want.1 {
        return Ok(());
    }
    let (got, want) = (format!("{got:?}"), format!("{want:?}"));
    Err(ModelError::Shape { which, got, want })
}

/// Everybody in `image`, whose alpha is ignored.
///
/// The detector sees 224 pixels a side, in which somebody a quarter as tall as the picture is wide is no more than a smudge:
/// long pictures are looked at in squares along them as well, and where nobody is found, in ever smaller squares.
/// An empty picture holds nobody.
pub fn find_people(models: &Models, image: &Image) -> Found {
    let mut found = Found {
        people: Vec::new(),
        best_score: 0.0,
        best_presence: 0.0,
    };
    if image.pixels.is_empty() {
        return found;
    }
    let mut scratch = models.rooms().pop().unwrap_or_default();
    let whole = Square::around(image);
    let mut look = |found: &mut Found, windows: &[Square]| {
        for window in windows {
            let is_part = window.side < whole.side;
            let (candidates, best_score) = candidates(models, (image, window), &mut scratch);
            found.best_score = found.best_score.max(best_score);
            for candidate in candidates {
                let (person, presence) = look_closer(models, image, candidate, &mut scratch);
                found.best_presence = found.best_presence.max(presence);
                // A window may show half of somebody, who is somebody else to the networks.
                let is_new = |p: &Person| {
                    let known = |q: &Person| same(p, q) || (is_part && overlap(p, q) > SHARED);
                    (!is_part || shown(p, window) >= WHOLE) && !found.people.iter().any(known)
                };
                if let Some(person) = person.filter(is_new) {
                    found.people.push(person);
                }
            }
        }
    };
    look(&mut found, &[whole]);
    let size = [image.width, image.height];
    let [long, short] = [size.into_iter().max(), size.into_iter().min()];
    let [long, short] = [long, short].map(|n| n.unwrap_or(0) as f64);
    if long > LONG * short {
        look(&mut found, &windows(size, short));
    }
    for part in PARTS {
        let side = part * short;
        if found.people.is_empty() && side >= SMALLEST {
            look(&mut found, &windows(size, side));
        }
    }
    models.rooms().push(scratch);
    found
        .people
        .sort_by(|a, b| b.square.side.total_cmp(&a.square.side));
    found
}

/// Upright squares of a side [px] that cover a picture, each overlapping the next by half or more.
fn windows(size: [usize; 2], side: f64) -> Vec<Square> {
    let along = |n: usize| {
        let way = (n as f64 - side).max(0.0);
        let count = (way / (0.5 * side)).ceil();
        (0..=count as usize).map(move |i| 0.5 * side + way * i as f64 / count.max(1.0))
    };
    let all = along(size[1]).flat_map(|y| along(size[0]).map(move |x| DVec2::new(x, y)));
    all.map(|centre| Square {
        centre,
        side,
        angle: 0.0,
    })
    .collect()
}

/// Squares that may hold people, the likeliest first, and the best score anywhere in a window of a picture.
fn candidates(
    models: &Models,
    (image, window): (&Image, &Square),
    scratch: &mut Scratch,
) -> (Vec<Candidate>, f64) {
    let input = crop::sample(image, window, 224, crop::Border::Black);
    let input: Vec<f32> = input
        .iter()
        .map(|&x| f32::from(x) * (2.0 / 255.0) - 1.0)
        .collect();
    let out = models
        .detector
        .run(&[&input], scratch)
        .expect("the shapes were checked");
    boxes::read(out[0], out[1], window)
}

/// The person in a candidate's square, if there is one, and how certain that is.
fn look_closer(
    models: &Models,
    image: &Image,
    candidate: Candidate,
    scratch: &mut Scratch,
) -> (Option<Person>, f64) {
    let square = candidate.square;
    // A person at the edge is shown the edge pixels going on: black there misleads the network.
    let input = crop::sample(image, &square, 256, crop::Border::Stretched);
    let input: Vec<f32> = input
        .iter()
        .map(|&x| f32::from(x) * (1.0 / 255.0))
        .collect();
    let out = models
        .landmarks
        .run(&[&input], scratch)
        .expect("the shapes were checked");
    let presence = f64::from(out[1][0]);
    if presence.is_nan() || presence <= LEAST_PRESENCE {
        return (None, presence.max(0.0));
    }
    let size = [image.width, image.height].map(|n| u32::try_from(n).unwrap_or(u32::MAX));
    let keypoints = points::read(out[0], out[2], out[3], (&square, size));
    let bounds = bounds(&keypoints);
    let person = Person {
        keypoints,
        score: candidate.score,
        presence,
        square,
        bounds,
    };
    (Some(person), presence)
}

fn bounds(keypoints: &Keypoints) -> [DVec2; 2] {
    let empty = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    let pixels = keypoints.points.iter().map(|p| p.pixel);
    pixels.fold(empty, |[low, high], p| [low.min(p), high.max(p)])
}

/// Share of somebody's points that a window shows.
fn shown(person: &Person, window: &Square) -> f64 {
    let points = &person.keypoints.points;
    let inside = points.iter().filter(|p| {
        let off = (p.pixel - window.centre).abs();
        off.max_element() <= 0.5 * window.side
    });
    inside.count() as f64 / points.len() as f64
}

/// Shared area of two people's bounds over that of the smaller, 0 to 1.
fn overlap(a: &Person, b: &Person) -> f64 {
    let area = |[low, high]: [DVec2; 2]| (high - low).max(DVec2::ZERO).element_product();
    let [p, q] = [a.bounds, b.bounds];
    let shared = area([p[0].max(q[0]), p[1].min(q[1])]);
    shared / area(p).min(area(q)).max(1.0)
}

/// Whether both are the same person, found twice.
fn same(a: &Person, b: &Person) -> bool {
    let (p, q) = (&a.keypoints.points, &b.keypoints.points);
    let apart: f64 = p
        .iter()
        .zip(q)
        .map(|(p, q)| p.pixel.distance(q.pixel))
        .sum();
    apart / p.len() as f64 <= SAME * a.square.side.min(b.square.side)
}
