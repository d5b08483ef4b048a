//! The results as files.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use muslin_geom::Report;
use muslin_io::{
    Clip, Dressed, Moved, Output, Scene, Skinned, animated_png, dressed_glb, moving_glb, png,
    report_json, writable,
};
use rayon::prelude::*;

use crate::apart::{apart, worn};
use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::files;
use crate::hero::Hero;
use crate::tell;

use super::bake::{self, Judged};
use super::motion;
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
pub struct Folders {
    folders: Vec<(PathBuf, Output)>,
    /// What the job reads.
    read: Vec<PathBuf>,
}

impl Folders {
    /// Opens the folders of all results of a job that reads these files, and what the options name.
    pub fn open(
        out: &Path,
        options: &SimulateOptions,
        mut read: Vec<PathBuf>,
    ) -> Result<Self, Failure> {
        read.extend(worn(&options.dress));
        read.push(motion::named(&options.motion).0.to_owned());
        let mut made = vec![out.to_owned(), beside(out, "report.json")];
        made.extend(options.npz.clone());
        if options.picture {
            made.extend(["png", "film.png"].map(|kind| beside(out, kind)));
        }
        if let Some(folder) = &options.pc2 {
            let garments = options
                .dress
                .outfit
                .iter()
                .map(|w| stem(Path::new(&w.garment)));
            for name in garments.chain(["body".into()]) {
                made.extend(["pc2", "obj"].map(|kind| folder.join(format!("{name}.{kind}"))));
            }
        }
        apart(&read, made)?;
        let parent = |p: &Path| p.parent().unwrap_or(Path::new("")).to_owned();
        for file in [Some(out), options.npz.as_deref()].into_iter().flatten() {
            writable(&named(file)).map_err(|e| file_failure(&e))?;
        }
        let mut folders = vec![parent(out)];
        folders.extend(options.npz.as_deref().map(parent));
        folders.extend(options.pc2.clone());
        folders.sort();
        folders.dedup();
        let open = |f: PathBuf| Output::open(&f).map(|o| (f, o));
        let opened: Result<Vec<_>, _> = folders.into_iter().map(open).collect();
        let folders = opened.map_err(|e| file_failure(&e))?;
        Ok(Self { folders, read })
    }

    /// Puts every file in its place: all of a folder's, or none.
    pub fn write(mut self, made: &[Made]) -> Result<(), Failure> {
        apart(&self.read, made.iter().map(|m| m.path.clone()))?;
        for file in made {
            let folder = file.path.parent().unwrap_or(Path::new(""));
            let name = named(&file.path);
            let own = self.folders.iter_mut().find(|(f, _)| f == folder);
            let (_, output) = own.expect("the folder of every result is opened");
            output
                .add(&name, &file.bytes)
                .map_err(|e| file_failure(&e))?;
        }
        for (_, output) in self.folders {
            output.commit().map_err(|e| file_failure(&e))?;
        }
        Ok(())
    }
}

/// Of how many frames one is in the GLB.
pub fn stride(frames: usize) -> usize {
    frames.saturating_sub(1).div_ceil(MOST_TARGETS).max(1)
}

/// What there is to be said where the GLB has not all frames.
pub fn thinned(clip: &Clip, bake: Bake) -> Option<String> {
    let step = stride(clip.drape.frames.len());
    (step > 1 && bake.is_exact()).then(|| {
        let nth = match step {
            2 => "every second".to_owned(),
            3 => "every third".to_owned(),
            n => format!("every {n}th"),
        };
        format!(
            "the GLB has {nth} frame, since viewers take 240 morph targets; --bake, --npz and --pc2 have all"
        )
    })
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

/// The report beside the main file of a training, where this one's is to go, as a file of a name that is free, and what
/// there is to be said of it; nothing, where no such report is in the way.
pub fn make_way(out: &Path) -> Result<Option<(Made, String)>, Failure> {
    let taken = beside(out, "report.json");
    if !tell::tells_of(&taken, "learnt_from") {
        return Ok(None);
    }
    let numbered = (2..).map(|n| beside(out, &format!("training-{n}.json")));
    let mut all = std::iter::once(beside(out, "training.json")).chain(numbered);
    let free = all.find(|p| !p.exists()).expect("numbers do not end");
    let fault = |e: std::io::Error| {
        Failure::new(Exit::Files, "cannot-read", e.to_string()).at(taken.display().to_string())
    };
    let bytes = std::fs::read(&taken).map_err(fault)?;
    let told = format!(
        "{} told of a training and is called {} now",
        taken.display(),
        free.display()
    );
    Ok(Some((Made { path: free, bytes }, told)))
}

/// What there is to be said of files of a run before that whoever reads these results would take for some of them.
pub fn leftovers(options: &SimulateOptions, made: &[Made]) -> Vec<String> {
    let is_made = |path: &Path| made.iter().any(|m| m.path == path);
    let mut told = Vec::new();
    if let Some(npz) = options.npz.as_deref().filter(|p| !is_made(p) && p.exists()) {
        told.push(format!(
            "{0} is of a run before, and garments have files of their own now: remove it, or `muslin evaluate {0}` reads it",
            npz.display()
        ));
    }
    let caches = options
        .pc2
        .as_deref()
        .map(|f| muslin_io::files_in(f, &["pc2"]));
    let mut old: Vec<String> = Vec::new();
    for path in caches.and_then(Result::ok).unwrap_or_default() {
        if !is_made(&path) {
            old.push(named(&path));
        }
    }
    if let (Some(folder), false) = (&options.pc2, old.is_empty()) {
        told.push(format!(
            "{} has caches of a run before ({}): remove them, or whoever reads the folder takes them for garments of this one",
            folder.display(),
            old.join(", ")
        ));
    }
    told
}

/// Whether a run of these inputs has ended, and all that it told of is there, as large as it was.
pub fn are_there(out: &Path, inputs: &str) -> bool {
    let report = std::fs::read_to_string(beside(out, "report.json")).unwrap_or_default();
    if !report.contains(&format!("\"inputs_sha256\": \"{inputs}\"")) {
        return false;
    }
    let files = report.split_once("\"files\": {");
    let Some((files, _)) = files.and_then(|(_, f)| f.split_once('}')) else {
        return false;
    };
    let is_there = |line: &str| {
        let (name, bytes) = line.trim().trim_end_matches(',').rsplit_once(": ")?;
        let file = std::fs::metadata(name.trim_matches('"')).ok()?;
        Some(file.len() == bytes.parse::<u64>().ok()?)
    };
    let mut all = files.lines().filter(|l| !l.trim().is_empty()).peekable();
    all.peek().is_some() && all.all(|line| is_there(line) == Some(true))
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

fn named(path: &Path) -> String {
    muslin_io::name(Path::new(path.file_name().unwrap_or_default()))
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
        assert!(make_way(&out).expect("nothing is there").is_none());
        std::fs::write(&report, "{\"learnt_from\": {}}").expect("it is written");
        std::fs::write(folder.join("tee.training.json"), "{}").expect("it is written");
        let (kept, told) = make_way(&out)
            .expect("it is readable")
            .expect("it is in the way");
        assert!(told.contains("tee.training-2.json"), "{told}");
        assert_eq!(kept.path, folder.join("tee.training-2.json"));
        assert_eq!(kept.bytes, b"{\"learnt_from\": {}}");
        assert!(report.exists() && !kept.path.exists());
        std::fs::write(&report, "{\"animation\": {}}").expect("it is written");
        assert!(make_way(&out).expect("it is nobody's").is_none());
        std::fs::remove_dir_all(&folder).expect("our own folder");
    }

    #[test]
    fn files_of_a_run_before_are_told_of() {
        let folder = std::env::temp_dir().join(format!("muslin-left-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("our own folder");
        let there = |name: &str| {
            let path = folder.join(name);
            std::fs::write(&path, "").expect("it is written");
            Made {
                path,
                bytes: Vec::new(),
            }
        };
        let options = SimulateOptions {
            npz: Some(folder.join("w.npz")),
            pc2: Some(folder.clone()),
            ..SimulateOptions::default()
        };
        let (whole, cache) = (there("w.npz"), there("tee.pc2"));
        let both = [whole, cache];
        assert_eq!(leftovers(&options, &both), Vec::<String>::new());
        let told = leftovers(&options, &[there("w.tee.npz"), there("skirt.pc2")]);
        assert!(told[0].contains("w.npz is of a run before"), "{told:?}");
        assert!(told[1].contains("(tee.pc2)"), "{told:?}");
        std::fs::remove_dir_all(&folder).expect("our own folder");
    }

    #[test]
    fn a_glb_never_gets_more_targets_than_viewers_take() {
        assert_eq!([1, 60, 241, 242, 481, 482].map(stride), [1, 1, 1, 2, 2, 3]);
    }
}
