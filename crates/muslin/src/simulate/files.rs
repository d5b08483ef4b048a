//! The results as files.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use muslin_geom::Report;
use muslin_io::{
    Clip, Dressed, Moved, Output, Scene, Skinned, animated_png, dressed_glb, moving_glb, png,
    report_json,
};
use rayon::prelude::*;

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::files;
use crate::hero::Hero;
use crate::tell;

use super::bake::{self, Judged};
use super::set::Set;
use super::{Bake, SimulateOptions, film};

/// More morph targets than this are for no viewer: every n-th frame is taken.
const MOST_TARGETS: usize = 240;

/// A file to be written.
pub struct Made {
    /// Where.
    pub path: PathBuf,
    /// What.
    pub bytes: Vec<u8>,
}

/// Folders to be filled, checked before the work begins.
pub struct Folders(Vec<(PathBuf, Output)>);

impl Folders {
    /// Opens the folders of all results.
    pub fn open(out: &Path, options: &SimulateOptions) -> Result<Self, Failure> {
        let parent = |p: &Path| p.parent().unwrap_or(Path::new("")).to_owned();
        let mut folders = vec![parent(out)];
        folders.extend(options.npz.as_deref().map(parent));
        folders.extend(options.pc2.clone());
        folders.sort();
        folders.dedup();
        let open = |f: PathBuf| Output::open(&f).map(|o| (f, o));
        let opened: Result<Vec<_>, _> = folders.into_iter().map(open).collect();
        opened.map(Self).map_err(|e| file_failure(&e))
    }

    /// Puts every file in its place: all of a folder's, or none.
    pub fn write(mut self, made: &[Made]) -> Result<(), Failure> {
        for file in made {
            let folder = file.path.parent().unwrap_or(Path::new(""));
            let name = muslin_io::name(Path::new(file.path.file_name().unwrap_or_default()));
            let own = self.0.iter_mut().find(|(f, _)| f == folder);
            let (_, output) = own.expect("the folder of every result is opened");
            output
                .add(&name, &file.bytes)
                .map_err(|e| file_failure(&e))?;
        }
        for (_, output) in self.0 {
            output.commit().map_err(|e| file_failure(&e))?;
        }
        Ok(())
    }
}

/// Of how many frames one is in the GLB.
pub fn stride(frames: usize) -> usize {
    frames.saturating_sub(1).div_ceil(MOST_TARGETS).max(1)
}

/// The bytes of all results but the report, and how far a baked animation is from the frames.
pub fn make(
    set: &Set,
    clip: &Clip,
    (out, options): (&Path, &SimulateOptions),
) -> Result<(Vec<Made>, Option<Judged>), Failure> {
    let fault = |e| file_failure(&e);
    // A character's file keeps all of its skin.
    let covered = match options.bake.is_exact() || set.hero.is_some() {
        true => Vec::new(),
        false => bake::covered(clip),
    };
    let bytes = glb(set, clip, (options.bake, &covered))?;
    let judged = match options.bake.is_exact() {
        true => None,
        false => Some(bake::judged(&bytes, clip)?),
    };
    let mut made = vec![Made {
        path: out.to_owned(),
        bytes,
    }];
    let mut add = |folder: &Path, files: Vec<(String, Vec<u8>)>| {
        let path = |name: &str| folder.join(name);
        made.extend(files.into_iter().map(|(name, bytes)| Made {
            path: path(&name),
            bytes,
        }));
    };
    if let Some(path) = &options.npz {
        let folder = path.parent().unwrap_or(Path::new(""));
        add(folder, clip.npz_files(&stem(path)).map_err(fault)?);
    }
    if let Some(folder) = &options.pc2 {
        add(folder, clip.pc2_files().map_err(fault)?);
    }
    if options.picture {
        let folder = out.parent().unwrap_or(Path::new(""));
        let shown = judged.as_ref().map_or(clip, |j| &j.shown);
        let film = film::pictures(
            (set, &covered),
            shown,
            (options.dress.backdrop, options.turn),
        );
        let name = stem(out);
        let moving = animated_png(&film.frames, film.frame_ms);
        let files = vec![
            (format!("{name}.png"), png(&film.still)),
            (format!("{name}.film.png"), moving),
        ];
        add(folder, files);
    }
    Ok((made, judged))
}

/// The report beside the main file of a training, where this one's is to go, gets a name of its own; which, if there is one.
pub fn make_way(out: &Path) -> Result<Option<String>, Failure> {
    let taken = beside(out, "report.json");
    if !tell::tells_of(&taken, "learnt_from") {
        return Ok(None);
    }
    let free = beside(out, "training.json");
    let fault = |e: std::io::Error| {
        Failure::new(Exit::Files, "cannot-write", e.to_string()).at(taken.display().to_string())
    };
    std::fs::rename(&taken, &free).map_err(fault)?;
    Ok(Some(format!(
        "{} told of a training and is called {} now",
        taken.display(),
        free.display()
    )))
}

fn beside(out: &Path, kind: &str) -> PathBuf {
    out.with_file_name(format!("{}.{kind}", stem(out)))
}

/// The report beside the main file.
pub fn report(out: &Path, report: &Report) -> Made {
    Made {
        path: beside(out, "report.json"),
        bytes: report_json(report).into_bytes(),
    }
}

fn stem(path: &Path) -> String {
    muslin_io::name(Path::new(path.file_stem().unwrap_or_default()))
}

/// The animation: garments as morphs or bones of their own, the body by its bones.
fn glb(set: &Set, clip: &Clip, (bake, covered): (Bake, &[bool])) -> Result<Vec<u8>, Failure> {
    let step = match bake.is_exact() {
        true => stride(clip.drape.frames.len()),
        false => 1,
    };
    let mut clip = clip.every(step);
    let seen = clip.body.par_iter().enumerate();
    clip.body = seen.map(|(i, skin)| set.seen(i * step, skin)).collect();
    clip.body_faces = set.avatar.body_faces().to_vec();
    let moved = |(node, source), baked| Moved {
        node,
        source,
        baked,
    };
    let body = moved(files::body(set.avatar, &clip.body[0]), None);
    let is_covered = |i: u32| covered.get(i as usize).copied().unwrap_or(false);
    let body = body.without(is_covered);
    let uv = set.outfit.uv(&set.cloth.rest);
    let faces = clip.drape.parts.iter().map(|p| p.faces.clone());
    let parts = clip.garments().into_iter().zip(&set.outfit.pieces);
    let garments: Vec<Moved> = parts
        .zip(faces)
        .map(|(((name, part), piece), faces)| {
            let verts = part.drape.frames[0].clone();
            let node = files::garment((name, piece), verts, &uv[faces]);
            moved(node, bake.garment(&part, covered))
        })
        .collect();
    if let Some(hero) = set.hero {
        return dressed(set, hero, (&clip, step), &garments);
    }
    let rig = set.avatar.export_rig();
    let poses = set.moving.motion.poses[set.moving.lead..]
        .iter()
        .step_by(step);
    // The skin at rest stands on the floor as well, for who shows it as it was bound.
    let lowered = DAffine3::from_translation(DVec3::NEG_Y * set.floor());
    let raised = lowered.inverse();
    let bones = poses.map(|p| {
        let bones = set.avatar.bones(&set.figure, p);
        let own = rig.source.iter().map(|&b| lowered * bones[b] * raised);
        own.collect()
    });
    let at_rest = |x: &DVec3| lowered.transform_point3(*x);
    let rest: Vec<DVec3> = set.figure.verts.iter().map(at_rest).collect();
    let skin = Skinned {
        rig: &rig.rig,
        heads: (rig.source.iter())
            .map(|&b| at_rest(&set.figure.joints[b]))
            .collect(),
        rest: &rest,
        bones: bones.collect(),
    };
    let scene = Scene {
        name: stem(Path::new(&set.moving.name)),
        copyright: Some(files::BODY_RIGHTS.into()),
        nodes: Vec::new(),
    };
    moving_glb(&scene, &clip, Some((&body, &skin)), &garments).map_err(|e| file_failure(&e))
}

/// The character's own file with the garments in it; `clip` has every `step`th frame.
fn dressed(
    set: &Set,
    hero: &Hero,
    (clip, step): (&Clip, usize),
    garments: &[Moved],
) -> Result<Vec<u8>, Failure> {
    let frames = clip.body.par_iter().enumerate().map(|(i, skin)| {
        let (joints, by) = set.joints_at(hero, (i * step, skin));
        let joints = joints.into_iter().zip(&hero.twin.follows);
        let joints = joints.map(|(j, follows)| follows.map(|_| j)).collect();
        (joints, hero.twin.yielded(&by).collect())
    });
    let (joints, yielded) = frames.collect();
    let played = Dressed {
        file: &hero.file,
        file_from_ours: hero.ours_from_file.inverse(),
        joints,
        yielded,
    };
    dressed_glb((&set.moving.name, clip), &played, garments).map_err(|e| file_failure(&e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_training_told_is_not_replaced() {
        let folder = std::env::temp_dir().join(format!("muslin-way-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("our own folder");
        let (out, report) = (folder.join("tee.glb"), folder.join("tee.report.json"));
        assert_eq!(make_way(&out), Ok(None));
        std::fs::write(&report, "{\"learnt_from\": {}}").expect("it is written");
        let told = make_way(&out).expect("it has a name");
        assert!(told.is_some_and(|t| t.contains("tee.training.json")));
        assert!(!report.exists() && folder.join("tee.training.json").exists());
        std::fs::write(&report, "{\"animation\": {}}").expect("it is written");
        assert_eq!(make_way(&out), Ok(None));
        std::fs::remove_dir_all(&folder).expect("our own folder");
    }

    #[test]
    fn a_glb_never_gets_more_targets_than_viewers_take() {
        assert_eq!([1, 60, 241, 242, 481, 482].map(stride), [1, 1, 1, 2, 2, 3]);
    }
}
