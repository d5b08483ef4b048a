//! BVH: a skeleton and its frames from the Biovision text format.
//!
//! The format was never written down by a committee, so files disagree. What we accept:
//! any channel order, one to six channels a joint, several roots, braces and keywords on
//! one line or many, commas between numbers, frame counts that lie. What we refuse:
//! numbers that are not finite, unbalanced braces, absurd depth or size.

use crate::{Fault, IoError, Place};
use glam::{DQuat, DVec3};
use muslin_body::retarget::{Frame, Recording, Skeleton};

const MAX_BYTES: usize = 256 << 20;
const MAX_JOINTS: usize = 4096;
const MAX_DEPTH: usize = 256;
const MAX_NUMBERS: usize = 32 << 20;
const MAX_NAME: usize = 64;

/// What is wrong, and on which line.
struct Bad {
    line: usize,
    what: String,
}

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
        let fault = Fault::new("bvh", name, bad.what).at(Place::Line(bad.line));
        fault.hint("export the recording as BVH again").invalid()
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
    let numbers = numbers(&mut words)?;
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

/// One channel: which axis, and whether it turns or moves.
#[derive(Clone, Copy)]
enum Channel {
    Position(usize),
    Rotation(usize),
}

struct Joint {
    name: String,
    parent: Option<usize>,
    offset: DVec3,
    end: Option<DVec3>,
    channels: Vec<Channel>,
}

fn error(line: usize, what: impl Into<String>) -> Bad {
    Bad {
        line,
        what: what.into(),
    }
}

/// Words with the line they stand on; braces are words of their own.
struct Words<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    rest: &'a str,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        Words {
            lines: text.lines().enumerate(),
            rest: "",
            line: 1,
        }
    }

    fn peek(&mut self) -> Option<&'a str> {
        let gap = |c: char| c.is_whitespace() || c == ',' || c == '\0';
        loop {
            self.rest = self.rest.trim_start_matches(gap);
            if !self.rest.is_empty() {
                break;
            }
            let (number, line) = self.lines.next()?;
            (self.line, self.rest) = (number + 1, line);
        }
        if self.rest.starts_with(['{', '}']) {
            return Some(&self.rest[..1]);
        }
        let end = self
            .rest
            .find(|c| gap(c) || c == '{' || c == '}')
            .unwrap_or(self.rest.len());
        Some(&self.rest[..end])
    }

    fn next(&mut self) -> Option<&'a str> {
        let word = self.peek()?;
        self.rest = &self.rest[word.len()..];
        Some(word)
    }

    /// The rest of this line, as a name.
    fn name(&mut self) -> &'a str {
        let end = self.rest.find('{').unwrap_or(self.rest.len());
        let (name, rest) = self.rest.split_at(end);
        self.rest = rest;
        name.trim()
    }

    fn word(&mut self, wanted: &str) -> Result<&'a str, Bad> {
        let line = self.line;
        self.next()
            .ok_or_else(|| error(line, format!("the file ends where {wanted} should be")))
    }

    fn number(&mut self, wanted: &str) -> Result<f64, Bad> {
        let word = self.word(wanted)?;
        parse(word, self.line)
    }

    fn vector(&mut self) -> Result<DVec3, Bad> {
        Ok(DVec3::new(
            self.number("x")?,
            self.number("y")?,
            self.number("z")?,
        ))
    }
}

fn parse(word: &str, line: usize) -> Result<f64, Bad> {
    let value: f64 = word
        .parse()
        .map_err(|_| error(line, format!("{:?} where a number should be", clean(word))))?;
    if value.is_finite() && value.abs() < 1e12 {
        return Ok(value);
    }
    Err(error(
        line,
        format!("{:?} is no usable number", clean(word)),
    ))
}

/// A name fit for printing: no control characters, 64 characters at most.
fn clean(name: &str) -> String {
    name.chars()
        .filter(|c| !c.is_control())
        .take(MAX_NAME)
        .collect()
}

fn hierarchy(words: &mut Words) -> Result<Vec<Joint>, Bad> {
    let first = words.word("HIERARCHY")?;
    if !first.eq_ignore_ascii_case("HIERARCHY") {
        return Err(error(
            words.line,
            format!("HIERARCHY expected, found {:?}", clean(first)),
        ));
    }
    let mut joints: Vec<Joint> = Vec::new();
    let mut open: Vec<Block> = Vec::new();
    while let Some(word) = words.next() {
        match word.to_ascii_uppercase().as_str() {
            "ROOT" | "JOINT" => begin(words, &mut joints, &mut open)?,
            "END" => begin_end_site(words, &mut open)?,
            "OFFSET" => set_offset(words, &mut joints, &open)?,
            "CHANNELS" => set_channels(words, &mut joints, &open)?,
            "}" => drop(
                open.pop()
                    .ok_or_else(|| error(words.line, "a brace too many"))?,
            ),
            "MOTION" => return finish(words.line, joints, &open),
            _ => return Err(error(words.line, format!("unknown word {:?}", clean(word)))),
        }
    }
    Err(error(words.line, "MOTION is missing"))
}

#[derive(Clone, Copy)]
enum Block {
    Joint(usize),
    End(usize),
}

fn finish(line: usize, joints: Vec<Joint>, open: &[Block]) -> Result<Vec<Joint>, Bad> {
    if !open.is_empty() {
        return Err(error(
            line,
            format!("{} braces are not closed before MOTION", open.len()),
        ));
    }
    if joints.is_empty() {
        return Err(error(line, "no joint"));
    }
    Ok(joints)
}

fn begin(w: &mut Words, joints: &mut Vec<Joint>, open: &mut Vec<Block>) -> Result<(), Bad> {
    let mut name = clean(w.name());
    if name.is_empty() {
        name = format!("joint{}", joints.len());
    }
    let parent = match open.last() {
        None => None,
        Some(&Block::Joint(parent)) => Some(parent),
        Some(Block::End(_)) => return Err(error(w.line, "a joint inside an End Site")),
    };
    if joints.len() >= MAX_JOINTS || open.len() >= MAX_DEPTH {
        let what = format!("more than {MAX_JOINTS} joints or {MAX_DEPTH} levels");
        return Err(error(w.line, what));
    }
    open_brace(w)?;
    open.push(Block::Joint(joints.len()));
    joints.push(Joint {
        name,
        parent,
        offset: DVec3::ZERO,
        end: None,
        channels: Vec::new(),
    });
    Ok(())
}

fn begin_end_site(w: &mut Words, open: &mut Vec<Block>) -> Result<(), Bad> {
    w.name();
    let Some(&Block::Joint(joint)) = open.last() else {
        return Err(error(w.line, "an End Site outside a joint"));
    };
    open_brace(w)?;
    open.push(Block::End(joint));
    Ok(())
}

fn open_brace(words: &mut Words) -> Result<(), Bad> {
    match words.word("{")? {
        "{" => Ok(()),
        other => Err(error(
            words.line,
            format!("{{ expected, found {:?}", clean(other)),
        )),
    }
}

fn set_offset(w: &mut Words, joints: &mut [Joint], open: &[Block]) -> Result<(), Bad> {
    let offset = w.vector()?;
    match open.last() {
        Some(&Block::Joint(j)) => joints[j].offset = offset,
        Some(&Block::End(j)) => joints[j].end = Some(offset),
        None => return Err(error(w.line, "OFFSET outside a joint")),
    }
    Ok(())
}

fn set_channels(w: &mut Words, joints: &mut [Joint], open: &[Block]) -> Result<(), Bad> {
    let Some(&Block::Joint(joint)) = open.last() else {
        return Err(error(w.line, "CHANNELS outside a joint"));
    };
    let count = w.number("the number of channels")?;
    if !(0.0..=6.0).contains(&count) || count.fract() != 0.0 {
        return Err(error(w.line, format!("{count} channels, allowed 0 to 6")));
    }
    let mut channels = Vec::new();
    for _ in 0..count as usize {
        let word = w.word("a channel")?;
        channels.push(channel(word).ok_or_else(|| unknown_channel(w.line, word))?);
    }
    joints[joint].channels = channels;
    Ok(())
}

fn unknown_channel(line: usize, word: &str) -> Bad {
    let what = format!(
        "unknown channel {:?}, allowed Xposition .. Zrotation",
        clean(word)
    );
    error(line, what)
}

fn channel(word: &str) -> Option<Channel> {
    let word = word.to_ascii_lowercase();
    let axis = "xyz".find(word.chars().next()?)?;
    match word.get(1..)? {
        "position" => Some(Channel::Position(axis)),
        "rotation" => Some(Channel::Rotation(axis)),
        _ => None,
    }
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

fn numbers(words: &mut Words) -> Result<Vec<f64>, Bad> {
    let mut numbers = Vec::new();
    while let Some(word) = words.next() {
        if numbers.len() >= MAX_NUMBERS {
            return Err(error(
                words.line,
                format!("more than {MAX_NUMBERS} numbers"),
            ));
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
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};

    const TINY: &str = "HIERARCHY\nROOT Base\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition \
        Zposition Zrotation Xrotation Yrotation\n JOINT Tip\n {\n  OFFSET 0 0 15\n  CHANNELS 3 \
        Zrotation Xrotation Yrotation\n  End Site\n  {\n   OFFSET 0 0 30\n  }\n }\n}\n";

    fn tiny(motion: &str) -> Result<Bvh, IoError> {
        read("a.bvh", format!("{TINY}{motion}").as_bytes())
    }

    #[test]
    fn known_values_come_back() {
        let bvh =
            tiny("MOTION\nFrames: 1\nFrame Time: 0.02\n1 2 3 90 0 0 0 90 0\n").expect("valid");
        let (skeleton, frame) = (&bvh.recording.skeleton, &bvh.recording.frames[0]);
        assert_eq!(skeleton.names, ["Base", "Tip"]);
        assert_eq!(skeleton.ends[1], Some(DVec3::new(0.0, 0.0, 30.0)));
        assert_eq!(frame.translations[0], DVec3::new(1.0, 2.0, 3.0));
        assert!((frame.rotations[0] * DVec3::X).distance(DVec3::Y) < 1e-12);
        assert!((frame.rotations[1] * DVec3::Y).distance(DVec3::Z) < 1e-12);
        assert!((bvh.recording.fps - 50.0).abs() < 1e-9 && bvh.warnings.is_empty());
    }

    #[test]
    fn rotations_compose_in_channel_order() {
        let bvh = tiny("MOTION\nFrames: 1\nFrame Time: 1\n0 0 0 90 90 0 0 0 0").expect("valid");
        let want =
            DQuat::from_rotation_z(90f64.to_radians()) * DQuat::from_rotation_x(90f64.to_radians());
        assert!(bvh.recording.frames[0].rotations[0].angle_between(want) < 1e-9);
    }

    #[test]
    fn frame_counts_may_lie_without_costing_memory() {
        let row = "0 0 0 0 0 0 0 0 0\n";
        let motion = format!("MOTION\nFrames: 99999999999\nFrame Time: 0.1\n{row}{row}1 2 3\n");
        let bvh = tiny(&motion).expect("readable");
        assert_eq!(bvh.recording.frames.len(), 2);
        assert_eq!(bvh.warnings.len(), 2, "{:?}", bvh.warnings);
    }

    #[test]
    fn several_roots_and_crowded_lines_are_read() {
        let text = "HIERARCHY ROOT A\n{OFFSET 1 2 3 CHANNELS 1 Xrotation}\nROOT B{\nOFFSET 0 0 1\n\
                    CHANNELS 3 Xposition,Yposition,Zposition}\nMOTION\nFrames:1\nFrame Time:0.5\n90 4 5 6";
        let bvh = read("a.bvh", text.as_bytes()).expect("valid");
        assert_eq!(bvh.recording.skeleton.parents, [None, None]);
        assert_eq!(
            bvh.recording.frames[0].translations[1],
            DVec3::new(4.0, 5.0, 7.0)
        );
    }

    #[test]
    fn bad_files_are_named_by_line() {
        let deep = format!("HIERARCHY\n{}", "ROOT a\n{\n".repeat(400));
        let cases: Vec<(String, &str)> = vec![
            (String::new(), "file ends"),
            ("PK\u{3}\u{4}".into(), "HIERARCHY expected"),
            (
                format!("{TINY}MOTION\nFrames: 1\nFrame Time: 1\n0 0 nan 0 0 0 0 0 0"),
                "usable",
            ),
            (
                format!("{TINY}MOTION\nFrames: 1\nFrame Time: 1\n0 0 x 0 0 0 0 0 0"),
                "number",
            ),
            (
                format!("{TINY}MOTION\nFrames: 1\nFrame Time: 1\n0 0"),
                "whole frame",
            ),
            (format!("{TINY}}}\nMOTION"), "brace too many"),
            (TINY.replace('}', " "), "MOTION is missing"),
            (format!("{}MOTION", TINY.replace('}', " ")), "not closed"),
            (
                TINY.replace("CHANNELS 6", "CHANNELS 600000000"),
                "allowed 0 to 6",
            ),
            (TINY.replace("Xposition", "Xscale"), "unknown channel"),
            (TINY.replace("OFFSET 0 0 15", "OFFSET 0 0"), "number"),
            (deep, "levels"),
        ];
        for (text, want) in cases {
            let error = read("a.bvh", text.as_bytes()).expect_err(want);
            assert!(
                error.to_string().contains(want),
                "{error} should say {want:?}"
            );
        }
    }

    #[test]
    fn names_are_made_printable() {
        let text = TINY
            .replace("Tip", "\u{1b}[31mTip\u{7}")
            .replace("Base", "");
        let text = format!("{text}MOTION\nFrames: 1\nFrame Time: 1\n0 0 0 0 0 0 0 0 0");
        let names = read("a.bvh", text.as_bytes())
            .expect("valid")
            .recording
            .skeleton
            .names;
        assert_eq!(names, ["joint0", "[31mTip"]);
    }

    #[test]
    fn no_prefix_of_a_file_panics() {
        let text = format!("{TINY}MOTION\nFrames: 1\nFrame Time: 0.02\n1 2 3 90 0 0 0 90 0\n");
        for end in 0..text.len() {
            let _ = read("a.bvh", &text.as_bytes()[..end]);
        }
    }

    #[test]
    fn every_shared_recording_is_read() {
        let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
            return println!("skipped: needs MUSLIN_DATA");
        };
        let mut files = Vec::new();
        collect(&data.join("motion"), &mut files);
        assert!(files.len() > 50, "{} files", files.len());
        for file in files {
            let bvh = read("a.bvh", &std::fs::read(&file).expect("readable")).expect("valid");
            assert!(
                bvh.warnings.is_empty(),
                "{}: {:?}",
                file.display(),
                bvh.warnings
            );
        }
        let liar =
            std::fs::read(data.join("robustness/bvh/frame_count_lies.bvh")).expect("readable");
        let warnings = read("a.bvh", &liar).expect("readable").warnings;
        assert!(
            warnings.iter().any(|w| w == "3 frames declared, 4 found"),
            "{warnings:?}"
        );
    }

    fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("folder") {
            let path = entry.expect("entry").path();
            match path.is_dir() {
                true => collect(&path, files),
                false if path.extension().is_some_and(|e| e == "bvh") => files.push(path),
                false => {}
            }
        }
    }

    /// Names of shoulder, elbow, wrist, hip, knee and ankle on the left side.
    const SCHOOLS: [(&str, [&str; 6]); 7] = [
        (
            "cmu-bvh/02_01_walk",
            [
                "LeftArm",
                "LeftForeArm",
                "LeftHand",
                "LeftUpLeg",
                "LeftLeg",
                "LeftFoot",
            ],
        ),
        (
            "cmu-fbx-as-bvh/85_03_acrobatics",
            [
                "Neo_LeftArm",
                "Neo_LeftForeArm",
                "Neo_LeftHand",
                "Neo_LeftUpLeg",
                "Neo_LeftLeg",
                "Neo_LeftFoot",
            ],
        ),
        (
            "cmu-fbx-as-bvh/91_48_locomotion",
            ["lShldr", "lForeArm", "lHand", "lThigh", "lShin", "lFoot"],
        ),
        (
            "non-commercial/bandai-namco/dataset-1_kick_normal_001",
            [
                "UpperArm_L",
                "LowerArm_L",
                "Hand_L",
                "UpperLeg_L",
                "LowerLeg_L",
                "Foot_L",
            ],
        ),
        (
            "other-skeletons/boxing_toes_100fps",
            [
                "LeftShoulder",
                "LeftElbow",
                "LeftWrist",
                "LeftHip",
                "LeftKnee",
                "LeftAnkle",
            ],
        ),
        (
            "reactidle/000_genuine",
            [
                "upper_arm.L",
                "forearm.L",
                "forearm.L",
                "thigh.L",
                "shin.L",
                "foot.L",
            ],
        ),
        (
            "makehuman-poses/fight01",
            [
                "upperarm01.L",
                "lowerarm01.L",
                "wrist.L",
                "upperleg01.L",
                "lowerleg01.L",
                "foot.L",
            ],
        ),
    ];

    #[test]
    fn recordings_of_every_school_move_our_limbs_alike() {
        use muslin_body::{Avatar, Shape, retarget::retarget};
        let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
            return println!("skipped: needs MUSLIN_DATA");
        };
        let avatar = Avatar::embedded().expect("the embedded body");
        let figure = avatar.figure(&Shape::default()).expect("an adult");
        let ours = [
            "upperarm01.L",
            "lowerarm01.L",
            "wrist.L",
            "upperleg01.L",
            "lowerleg01.L",
            "foot.L",
        ];
        for (file, theirs) in SCHOOLS {
            let path = data.join("motion").join(format!("{file}.bvh"));
            let bvh = read(file, &std::fs::read(path).expect("readable"))
                .expect("valid")
                .recording;
            for frame in [0, bvh.frames.len() / 2] {
                let pose = retarget(&avatar, &figure, &bvh, frame).expect("a human");
                let posed = avatar.pose(&figure, &pose);
                let at = |name: &str| {
                    let b = avatar.bone(name).expect("a bone");
                    posed.bones[b].transform_point3(figure.joints[b])
                };
                let points = heads(&bvh, frame);
                let head = |name: &str| {
                    points[bvh
                        .skeleton
                        .names
                        .iter()
                        .position(|n| n == name)
                        .expect(name)]
                };
                for (a, b) in [(0, 1), (1, 2), (3, 4), (4, 5)]
                    .into_iter()
                    .filter(|&(a, b)| theirs[a] != theirs[b])
                {
                    let want = head(theirs[b]) - head(theirs[a]);
                    let want = if file.starts_with("makehuman") {
                        DVec3::new(want.x, want.z, -want.y)
                    } else {
                        want
                    };
                    let off = (at(ours[b]) - at(ours[a])).angle_between(want).to_degrees();
                    assert!(
                        off < 0.01,
                        "{file} frame {frame}: {} is off by {off} degrees",
                        ours[a]
                    );
                }
                let up = (at("head") - at("foot.L")).y;
                assert!(
                    file.contains("acrobatics") || up > 0.5,
                    "{file} stands on its head"
                );
            }
        }
    }

    /// Where the joints are, by the shortest road.
    fn heads(recording: &Recording, frame: usize) -> Vec<DVec3> {
        let (skeleton, frame) = (&recording.skeleton, &recording.frames[frame]);
        let up = |mut joint: usize| {
            let mut point = frame.translations[joint];
            while let Some(parent) = skeleton.parents[joint] {
                point = frame.translations[parent] + frame.rotations[parent] * point;
                joint = parent;
            }
            point
        };
        (0..skeleton.names.len()).map(up).collect()
    }
}
