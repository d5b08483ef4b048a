//! BVH: a skeleton and its frames from the Biovision text format.
//!
//! The format was never written down by a committee, so files disagree. What we accept:
//! any channel order, one to six channels a joint, several roots, braces and keywords on
//! one line or many, commas between numbers, frame counts that lie. What we refuse:
//! numbers that are not finite, unbalanced braces, absurd depth or size.

mod hierarchy;
mod words;

use crate::{Fault, IoError, Place};
use glam::{DQuat, DVec3};
use hierarchy::{Channel, Joint, hierarchy};
use muslin_body::retarget::{Frame, Recording, Skeleton};
use words::{Bad, Words, clean, error, large, parse};

const MAX_BYTES: usize = 256 << 20;
const MAX_NUMBERS: usize = 32 << 20;
/// Joints of all frames together, whether or not they have numbers; 56 bytes each.
const MAX_PLACES: usize = 32 << 20;

/// A recording, and what had to be mended to read it.
#[derive(Debug, Clone)]
pub struct Bvh {
    /// Skeleton and frames, in the units of the file.
    pub recording: Recording,
    /// One sentence for each thing that the file says wrongly.
    pub warnings: Vec<String>,
}

/// Reads a BVH file; `name` is what errors call it.
///
/// Rotations are composed in channel order. Positions of a root are added to its offset,
/// unless they repeat it; positions of inner joints replace the offset where most of them
/// repeat it (Bandai-Namco, Blender), else they are added (MakeHuman writes zeros).
/// A last frame that is cut short is dropped with a warning.
pub fn read(name: &str, bytes: &[u8]) -> Result<Bvh, IoError> {
    if bytes.len() > MAX_BYTES {
        let fault = Fault::new("bvh-large", name, "too large for a recording");
        return Err(fault.found(bytes.len()).allowed(MAX_BYTES).refused());
    }
    parse_file(bytes).map_err(|bad| {
        let fault = |code| Fault::new(code, name, bad.what).at(Place::Line(bad.line));
        match bad.allowed {
            Some(allowed) => fault("bvh-large")
                .allowed(allowed)
                .hint("cut the recording, or leave out joints that do not move")
                .refused(),
            None => fault("bvh")
                .hint("export the recording as BVH again")
                .invalid(),
        }
    })
}

fn parse_file(bytes: &[u8]) -> Result<Bvh, Bad> {
    let text = String::from_utf8_lossy(bytes);
    let mut words = Words::new(text.trim_start_matches('\u{feff}'));
    let joints = hierarchy(&mut words)?;
    let mut warnings = Vec::new();
    while words
        .peek()
        .is_some_and(|w| w.eq_ignore_ascii_case("MOTION"))
    {
        words.next();
        warnings.push("MOTION stands more than once".to_string());
    }
    let (declared, frame_time) = motion_head(&mut words)?;
    let fps = frames_per_second(frame_time, &mut warnings);
    let numbers = numbers(&mut words, MAX_NUMBERS)?;
    let frames = frames(&joints, &numbers, declared, &mut warnings)?;
    let recording = Recording {
        skeleton: skeleton(joints),
        fps,
        frames,
    };
    Ok(Bvh {
        recording,
        warnings,
    })
}

/// Declared number of frames and the frame time [s].
fn motion_head(words: &mut Words) -> Result<(f64, f64), Bad> {
    let frames = labelled(words, "frames")?;
    if words
        .peek()
        .is_some_and(|w| !w.to_ascii_lowercase().starts_with("frame"))
    {
        return Err(error(words.line, "Frame Time expected"));
    }
    words.next();
    Ok((frames, labelled(words, "time")?))
}

/// The number of `label: 12`, `label : 12` or `label:12`.
fn labelled(words: &mut Words, label: &str) -> Result<f64, Bad> {
    let word = words.word(label)?;
    let lower = word.to_ascii_lowercase();
    let Some(rest) = lower.strip_prefix(label) else {
        return Err(error(
            words.line,
            format!("{label}: expected, found {:?}", clean(word)),
        ));
    };
    let mut rest = rest.trim_start_matches(':').to_string();
    if rest.is_empty() {
        rest = words.word(label)?.trim_start_matches(':').to_string();
    }
    if rest.is_empty() {
        rest = words.word(label)?.to_string();
    }
    parse(&rest, words.line)
}

fn frames_per_second(frame_time: f64, warnings: &mut Vec<String>) -> f64 {
    if (1e-5..=1e3).contains(&frame_time) {
        return 1.0 / frame_time;
    }
    warnings.push(format!(
        "frame time {frame_time} s is unusable; 30 frames a second assumed"
    ));
    30.0
}

fn numbers(words: &mut Words, most: usize) -> Result<Vec<f64>, Bad> {
    let mut numbers = Vec::new();
    while let Some(word) = words.next() {
        if numbers.len() >= most {
            return Err(large(words.line, "too many numbers", most.to_string()));
        }
        numbers.push(parse(word, words.line)?);
    }
    Ok(numbers)
}

fn skeleton(joints: Vec<Joint>) -> Skeleton {
    Skeleton {
        parents: joints.iter().map(|j| j.parent).collect(),
        offsets: joints.iter().map(|j| j.offset).collect(),
        ends: joints.iter().map(|j| j.end).collect(),
        names: joints.into_iter().map(|j| j.name).collect(),
    }
}

fn frames(
    joints: &[Joint],
    numbers: &[f64],
    declared: f64,
    warnings: &mut Vec<String>,
) -> Result<Vec<Frame>, Bad> {
    let width: usize = joints.iter().map(|j| j.channels.len()).sum();
    if width == 0 {
        return Err(error(1, "no joint has a channel"));
    }
    let (count, rest) = (numbers.len() / width, numbers.len() % width);
    if rest != 0 {
        warnings.push(format!(
            "the last frame has {rest} of {width} numbers and was dropped"
        ));
    }
    if count as f64 != declared {
        warnings.push(format!("{declared} frames declared, {count} found"));
    }
    if numbers.len() < width {
        return Err(error(
            1,
            format!("no whole frame: {} of {width} numbers", numbers.len()),
        ));
    }
    if count.saturating_mul(joints.len()) > MAX_PLACES {
        let what = format!("{count} frames of {} joints are too many", joints.len());
        let allowed = format!("{MAX_PLACES} joints in all frames");
        return Err(large(1, what, allowed));
    }
    let absolute = positions_are_absolute(joints, &numbers[..width]);
    Ok(numbers
        .chunks_exact(width)
        .map(|row| frame(joints, row, absolute))
        .collect())
}

/// Whether the positions of roots, and of inner joints, replace the offsets.
fn positions_are_absolute(joints: &[Joint], row: &[f64]) -> [bool; 2] {
    let mut votes = [0i64; 2];
    let mut at = 0;
    for joint in joints {
        let (position, _) = channels(&joint.channels, &row[at..]);
        at += joint.channels.len();
        if let Some(p) = position
            && joint.offset.length() > 0.0
        {
            let repeats = p.distance(joint.offset) < 0.25 * p.length();
            votes[usize::from(joint.parent.is_some())] += if repeats { 1 } else { -1 };
        }
    }
    votes.map(|v| v > 0)
}

fn frame(joints: &[Joint], row: &[f64], absolute: [bool; 2]) -> Frame {
    let mut frame = Frame {
        translations: Vec::new(),
        rotations: Vec::new(),
    };
    let mut at = 0;
    for joint in joints {
        let (position, rotation) = channels(&joint.channels, &row[at..]);
        at += joint.channels.len();
        let base = match absolute[usize::from(joint.parent.is_some())] && position.is_some() {
            true => DVec3::ZERO,
            false => joint.offset,
        };
        frame
            .translations
            .push(base + position.unwrap_or(DVec3::ZERO));
        frame.rotations.push(rotation);
    }
    frame
}

/// Position, if there are position channels, and rotation of one joint.
fn channels(channels: &[Channel], values: &[f64]) -> (Option<DVec3>, DQuat) {
    let (mut position, mut rotation) = (None, DQuat::IDENTITY);
    for (channel, &value) in channels.iter().zip(values) {
        match *channel {
            Channel::Position(axis) => position.get_or_insert(DVec3::ZERO)[axis] = value,
            Channel::Rotation(axis) => {
                let angle = value.rem_euclid(360.0).to_radians();
                rotation *= DQuat::from_axis_angle(DVec3::AXES[axis], angle);
            }
        }
    }
    (position, rotation.normalize())
}

#[cfg(test)]
mod tests;
