//! What a fit cannot know, told plainly.

use crate::evidence::Evidence;
use crate::solve::FitOptions;

/// Parts of the body and the markers that show them.
const PARTS: [(&str, &[usize]); 7] = [
    ("face", &[0, 1, 2]),
    ("left arm", &[5, 7, 9]),
    ("right arm", &[6, 8, 10]),
    ("left leg", &[11, 13, 15]),
    ("right leg", &[12, 14, 16]),
    ("left foot", &[17, 21]),
    ("right foot", &[18, 22]),
];

/// What follows the name of a part of the body that the points do not show.
pub const UNSEEN: &str = ": hidden or unclear";

/// A part whose points score less than this is guessed more than seen.
const SEEN: f64 = 0.5;

/// One line for each thing that the points do not show.
pub fn list(evidence: &Evidence, options: &FitOptions) -> Vec<String> {
    let mut doubts = Vec::new();
    let mut say = |doubt: bool, text: &str| {
        if doubt {
            doubts.push(text.to_string());
        }
    };
    say(
        options.height_m.is_none(),
        "height: assumed, as no picture shows it; give it",
    );
    say(
        options.weight_kg.is_none(),
        "girth: as expected at this height; give the weight",
    );
    say(true, "twist of straight arms and legs");
    say(
        !evidence.has_depth(),
        "depth: from the plane of the picture alone",
    );
    say(
        options.focal_px.is_none(),
        "distance and focal length: they trade for each other",
    );
    for (part, markers) in PARTS {
        let score = |&k: &usize| evidence.marker(k).map_or(0.0, |s| s.score);
        if markers.iter().map(score).fold(1.0, f64::min) < SEEN {
            doubts.push(format!("{part}{UNSEEN}"));
        }
    }
    doubts
}
