//! The first half of a BVH file: the tree of joints.

use glam::DVec3;

use super::words::{Bad, Words, clean, error, large};

const MAX_JOINTS: usize = 4096;
const MAX_DEPTH: usize = 256;

/// One channel: which axis, and whether it turns or moves.
#[derive(Clone, Copy)]
pub enum Channel {
    Position(usize),
    Rotation(usize),
}

/// A joint as the file tells it.
pub struct Joint {
    pub name: String,
    pub parent: Option<usize>,
    pub offset: DVec3,
    pub end: Option<DVec3>,
    pub channels: Vec<Channel>,
}

/// The joints, parents first, up to the word MOTION.
pub fn hierarchy(words: &mut Words) -> Result<Vec<Joint>, Bad> {
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
        let allowed = format!("{MAX_JOINTS} joints, {MAX_DEPTH} levels");
        return Err(large(w.line, "too many joints or levels", allowed));
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
