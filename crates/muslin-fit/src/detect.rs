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
    let (candidates, best_score) = candidates(models, image, &mut scratch);
    found.best_score = best_score;
    for candidate in candidates {
        let (person, presence) = look_closer(models, image, candidate, &mut scratch);
        found.best_presence = found.best_presence.max(presence);
        let known = |p: &Person| found.people.iter().any(|q| same(p, q));
        if let Some(person) = person.filter(|p| !known(p)) {
            found.people.push(person);
        }
    }
    models.rooms().push(scratch);
    found
        .people
        .sort_by(|a, b| b.square.side.total_cmp(&a.square.side));
    found
}

/// Squares that may hold people, the likeliest first, and the best score anywhere.
fn candidates(models: &Models, image: &Image, scratch: &mut Scratch) -> (Vec<Candidate>, f64) {
    let whole = Square::around(image);
    let input = crop::sample(image, &whole, 224, crop::Border::Black);
    let input: Vec<f32> = input
        .iter()
        .map(|&x| f32::from(x) * (2.0 / 255.0) - 1.0)
        .collect();
    let out = models
        .detector
        .run(&[&input], scratch)
        .expect("the shapes were checked");
    boxes::read(out[0], out[1], &whole)
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
