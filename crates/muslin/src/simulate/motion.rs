//! Motion in: built in by name, or from a file, on a figure, with the way in from the rest pose.

use std::path::Path;

use muslin_body::retarget::{self, Recording};
use muslin_body::{Avatar, Figure, Motion, Pose, motions, names};
use muslin_geom::Report;
use muslin_io::{Input, bvh, is_fbx, read_animation, read_file, read_poses};
use rayon::prelude::*;

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::hero::Hero;

use super::{SimulateOptions, room};

/// A motion ready to be danced.
pub struct Moving {
    /// As asked for: a name, or a file's.
    pub name: String,
    /// SHA-256 of the file, if it is from one: a recording's, or the character's whose animation it is.
    pub sha256: Option<String>,
    /// The lead-in and the motion.
    pub motion: Motion,
    /// Poses of the lead-in.
    pub lead: usize,
    /// By how much limbs were turned to make room for cloth at most [rad].
    pub turned: f64,
    /// What the user should know of the file.
    pub warnings: Vec<String>,
}

impl Moving {
    /// How many frames are delivered.
    pub fn frames(&self) -> usize {
        self.motion.poses.len() - self.lead
    }

    /// What the report says of it.
    pub fn report(&self) -> Report {
        let mut r = Report::default();
        r.set("name", self.name.as_str());
        if let Some(hash) = &self.sha256 {
            r.set("sha256", hash.as_str());
        }
        r.set("frames", self.frames());
        r.set("frames_per_second", self.motion.fps);
        let turned = self.turned.to_degrees();
        r.set("limbs_turned_deg", (turned * 100.0).round() / 100.0);
        r
    }
}

/// Files with more bytes are refused.
const MAX_BYTES: u64 = 512 << 20;
/// On the way in no joint turns farther [rad] and the body goes no farther [m] in one frame.
const LEAD_IN: (f64, f64) = (0.06, 0.02);
/// Limbs that are turned farther off a motion than this are told of [rad].
const FAR: f64 = 0.35;
/// Frames that the way in has at least, and at most.
const SHORTEST: usize = 15;
const LONGEST: usize = 20_000;
/// So many names of animations are told.
const MANY: usize = 8;
/// Motions with more frames are refused.
const MOST_FRAMES: usize = 1 << 20;

/// The motion that the options ask for.
pub fn load(
    (avatar, hero): (&Avatar, Option<&Hero>),
    figure: &Figure,
    options: &SimulateOptions,
) -> Result<Moving, Failure> {
    let (mut found, mut cut) = asked((avatar, hero), figure, options)?;
    found.turned = room::make_room(avatar, figure, &mut cut).map_err(|e| body_failure(&e))?;
    if found.turned > FAR {
        found.warnings.push(format!(
            "limbs are turned by up to {:.0} degrees off the motion, where it leads the body deeper into itself than cloth can follow",
            found.turned.to_degrees()
        ));
    }
    let (rest, _) = avatar.dressing(figure);
    found.lead = cut.steps_from(&rest, LEAD_IN).max(SHORTEST);
    if found.lead > LONGEST {
        let root = cut.poses[0].root;
        let what = format!(
            "its first pose is {:.0} m off the body at rest",
            root.length()
        );
        let fault = Failure::new(Exit::Refused, "far-motion", what).at(found.name);
        return Err(fault.hint("poses are in metres, over the origin; scale the file"));
    }
    found.motion = cut.with_lead_in(&rest, found.lead);
    if !found.motion.is_sound() {
        let fault = Failure::new(Exit::Numbers, "motion", "a pose is not finite");
        return Err(fault.at(found.name));
    }
    Ok(found)
}

/// How many frames of the motion are delivered.
pub fn frames(
    who: (&Avatar, Option<&Hero>),
    figure: &Figure,
    options: &SimulateOptions,
) -> Result<usize, Failure> {
    Ok(asked(who, figure, options)?.1.poses.len())
}

/// The motion of that name, whole, and the part that is asked for at the rate that is asked for.
fn asked(
    (avatar, hero): (&Avatar, Option<&Hero>),
    figure: &Figure,
    options: &SimulateOptions,
) -> Result<(Moving, Motion), Failure> {
    let (path, part) = named(&options.motion);
    let clip = match hero {
        Some(hero) => own(hero, options)?,
        None => None,
    };
    let ours = |name: &&str| name.eq_ignore_ascii_case(&options.motion);
    let found = match (clip, motions::NAMES.into_iter().find(ours)) {
        (Some(own), _) => own,
        (None, Some(name)) => built_in(avatar, figure, (name, options.fps))?,
        (None, None) if path.exists() || has_kind(path) => file(avatar, figure, (path, part))?,
        (None, None) => return Err(unknown(&options.motion, hero)),
    };
    let cut = cut(&found.motion, options).map_err(|f| f.at(found.name.clone()))?;
    Ok((found, cut))
}

/// An animation of the character's own file, if it has one of that name.
fn own(hero: &Hero, options: &SimulateOptions) -> Result<Option<Moving>, Failure> {
    let motion = hero.clip(&options.motion, options.fps)?;
    Ok(motion.map(|motion| Moving {
        name: options.motion.clone(),
        sha256: Some(hero.file.sha256.clone()),
        motion,
        lead: 0,
        turned: 0.0,
        warnings: Vec::new(),
    }))
}

fn built_in(avatar: &Avatar, figure: &Figure, (name, fps): (&str, f64)) -> Result<Moving, Failure> {
    let motion = motions::make(avatar, figure, name, fps);
    Ok(Moving {
        name: name.to_owned(),
        sha256: None,
        motion: motion.map_err(|e| body_failure(&e))?,
        lead: 0,
        turned: 0.0,
        warnings: Vec::new(),
    })
}

/// Kinds of files with motions that are taken from folders, and those that may be named besides: whole characters.
pub const KINDS: [&str; 3] = ["bvh", "npz", "vrma"];
const CHARACTERS: [&str; 3] = ["glb", "gltf", "vrm"];
/// Animations are read at this rate [1/s].
const RATE: f64 = 60.0;

fn has_kind(path: &Path) -> bool {
    let mut kinds = KINDS.iter().chain(&CHARACTERS);
    let extension = path.extension();
    extension.is_some_and(|e| kinds.any(|k| e.eq_ignore_ascii_case(k)))
}

/// A file, and which of its animations is meant: `FILE#NAME`.
pub fn named(motion: &str) -> (&Path, Option<&str>) {
    let whole = Path::new(motion);
    match motion.rsplit_once('#') {
        Some((file, part)) if !whole.exists() && has_kind(Path::new(file)) => {
            (Path::new(file), Some(part))
        }
        _ => (whole, None),
    }
}

fn unknown(asked: &str, hero: Option<&Hero>) -> Failure {
    let own = hero.into_iter().flat_map(|h| &h.file.clips);
    let near = names::nearest(
        asked,
        motions::NAMES.into_iter().chain(own.map(String::as_str)),
    );
    let what = format!("no motion is called {asked:?}, and there is no such file");
    let hint = format!(
        "did you mean {}? `muslin list motions` shows all; files are .bvh, .npz, .vrma, .glb, .gltf or .vrm",
        near.join(", ")
    );
    Failure::new(Exit::Usage, "unknown-motion", what)
        .at("--motion")
        .hint(hint)
}

fn file(
    avatar: &Avatar,
    figure: &Figure,
    (path, part): (&Path, Option<&str>),
) -> Result<Moving, Failure> {
    let input = read_file(path, MAX_BYTES).map_err(|e| file_failure(&e))?;
    let begins = |with: &[u8]| input.bytes.starts_with(with);
    if is_fbx(&input.bytes) {
        let what = "an FBX file is no recording that our body can follow";
        let fault = Failure::new(Exit::Refused, "no-recording", what).at(input.file);
        return Err(fault.hint("export it as GLB or BVH"));
    }
    let is_json = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("gltf"));
    let who = (avatar, figure, input.file.as_str());
    let (motion, warnings) = if begins(b"glTF") || is_json {
        animated(who, (path, &input), part)?
    } else if let Some(part) = part {
        let what = format!("it has one motion only, none called {part:?}");
        return Err(Failure::new(Exit::Invalid, "one-motion", what).at(input.file));
    } else if begins(b"PK") {
        let read = read_poses(avatar, &input.file, &input.bytes);
        (read.map_err(|e| file_failure(&e))?, Vec::new())
    } else {
        let read = bvh::read(&input.file, &input.bytes).map_err(|e| file_failure(&e))?;
        followed(who, (read.recording, read.warnings))?
    };
    Ok(Moving {
        sha256: Some(input.sha256()),
        name: match part {
            Some(part) => format!("{}#{part}", input.file),
            None => input.file,
        },
        motion,
        lead: 0,
        turned: 0.0,
        warnings,
    })
}

/// An animation of a glTF file on our figure.
fn animated(
    who: (&Avatar, &Figure, &str),
    (path, input): (&Path, &Input),
    part: Option<&str>,
) -> Result<(Motion, Vec<String>), Failure> {
    let read = read_animation(path, input, (part, RATE)).map_err(|e| file_failure(&e))?;
    let mut warnings = Vec::new();
    if let (None, [first, others @ ..]) = (part, read.clips.as_slice())
        && !others.is_empty()
    {
        let more = if others.len() > MANY { ", ..." } else { "" };
        let some = &others[..others.len().min(MANY)];
        warnings.push(format!(
            "it has {} animations, and {first:?} is played; FILE#NAME names another: {}{more}",
            read.clips.len(),
            some.join(", ")
        ));
    }
    followed(who, (read.recording, warnings))
}

/// A recording on our figure, hands at ease.
fn followed(
    (avatar, figure, file): (&Avatar, &Figure, &str),
    (mut recording, mut warnings): (Recording, Vec<String>),
) -> Result<(Motion, Vec<String>), Failure> {
    let place = |e: &muslin_body::BodyError| body_failure(e).at(file);
    let follow = |r: &Recording| retarget::retarget_all(avatar, figure, r);
    let mut motion = follow(&recording).map_err(|e| place(&e))?;
    let (_, false_start) = motion.without_false_start();
    if false_start > 0 {
        // Limbs go on from frame to frame: the ones left out must not have been seen.
        recording.frames.drain(..false_start);
        motion = follow(&recording).map_err(|e| place(&e))?;
        warnings.push(match false_start {
            1 => "the first frame jumps away and is left out".into(),
            n => format!("the first {n} frames jump away and are left out"),
        });
    }
    let relax = |p: &mut Pose| p.relax_hands(avatar, figure);
    let relaxed = motion.poses.par_iter_mut().map(relax);
    relaxed.collect::<Result<(), _>>().map_err(|e| place(&e))?;
    let told = warnings.into_iter().map(|w| format!("{file}: {w}"));
    Ok((motion, told.collect()))
}

/// The part that is asked for, at the rate that is asked for, from over the origin.
fn cut(motion: &Motion, options: &SimulateOptions) -> Result<Motion, Failure> {
    let (all, fps) = (motion.count_at(options.fps), options.fps);
    let skip = (options.start * fps).round() as usize;
    if skip >= all {
        let what = format!(
            "--start {} s is beyond its end at {:.2} s",
            options.start,
            motion.duration()
        );
        return Err(Failure::new(Exit::Usage, "out-of-range", what));
    }
    let most = options.seconds.map(|s| (s * fps).round() as usize);
    let count = most.unwrap_or(usize::MAX).clamp(1, all - skip);
    if count > MOST_FRAMES {
        let what = format!(
            "{count} frames, for it lasts {:.0} s (at most {MOST_FRAMES})",
            motion.duration()
        );
        let fault = Failure::new(Exit::Refused, "long-motion", what);
        return Err(fault.hint(
            "--start and --seconds take a part; a recording that is not as long has a wrong rate or frame time",
        ));
    }
    let motion = motion.part(fps, skip..skip + count);
    Ok(motion.from_origin())
}
