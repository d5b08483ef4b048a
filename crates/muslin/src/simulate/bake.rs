//! Small animations: garments as few handles and shapes, and a body without what they cover.

use glam::DVec3;
use muslin_geom::{Baked, Report, Surface, vertex_normals};
use muslin_io::{Clip, read_moving};
use rayon::prelude::*;

use crate::dress::file_failure;
use crate::failure::Failure;

use super::quality::round;

/// How garments are written in a `.glb`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bake {
    /// A morph target for every frame, exactly as it is; at most 240 of them.
    #[default]
    Frames,
    /// So many morph targets that are mixed, above a few bones of the garment's own.
    Morphs(usize),
    /// So many bones of the garment's own and no morph target, for players that know none.
    Bones(usize),
}

/// What there is by default of either, and at most.
const MORPHS: (usize, usize) = (32, 256);
const BONES: (usize, usize) = (128, 250);
/// Bones below morph targets.
const BELOW: usize = 24;

/// Skin nearer than this behind cloth is covered by it [m].
const COVERED: f64 = 0.06;
/// Rings of vertices at a hem that cover nothing, for they slide.
const HEM: usize = 2;
/// Share of the frames in which that cloth must lie before the skin, not only near it.
const MOSTLY: f64 = 0.7;
/// Rounds in which baked cloth is led out of skin, how far outside it is to end [m], how deep it is looked
/// for [m], and how much such a vertex counts.
const ROUNDS: usize = 6;
const ROOM: f64 = 1.5e-3;
const REACH: f64 = 0.02;
const PULL: f64 = 10.0;
/// Frames that skin must be covered in, at most, evenly chosen.
const LOOKED: usize = 60;

impl Bake {
    /// From `frames`, `morphs`, `bones`, or one of the latter two with a number: `bones:64`.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (kind, number) = match text.split_once(':') {
            Some((kind, number)) => (kind, Some(number)),
            None => (text, None),
        };
        let count = |(usual, most): (usize, usize)| match number.map(str::parse::<usize>) {
            None => Ok(usual),
            Some(Ok(n)) if (1..=most).contains(&n) => Ok(n),
            _ => Err(format!("a number from 1 to {most}, as in bones:64")),
        };
        match kind {
            "frames" if number.is_none() => Ok(Self::Frames),
            "morphs" => count(MORPHS).map(Self::Morphs),
            "bones" => count(BONES).map(Self::Bones),
            _ => Err("frames, morphs[:N] or bones[:N]".to_owned()),
        }
    }

    fn counts(self) -> Option<muslin_geom::Bake> {
        let (handles, shapes) = match self {
            Self::Frames => return None,
            Self::Morphs(n) => (BELOW, n),
            Self::Bones(n) => (n, 0),
        };
        Some(muslin_geom::Bake { handles, shapes })
    }

    /// Whether frames are written as they are.
    pub fn is_exact(self) -> bool {
        self == Self::Frames
    }

    /// The garment of `clip`, reduced, and led out of the skin that is not `covered`; nothing where frames
    /// are written as they are.
    pub fn garment(self, clip: &Clip, covered: &[bool]) -> Option<Baked> {
        let faces = &clip.drape.faces;
        let mut baked = Baked::new(&clip.drape.frames, faces, self.counts()?);
        lead_out(&mut baked, clip, covered);
        Some(baked)
    }
}

/// Leads vertices that came to lie in skin that is seen out of it, as far as handles and shapes can.
fn lead_out(baked: &mut Baked, clip: &Clip, covered: &[bool]) {
    let frames = clip.drape.frames.len();
    let one = |t: usize| {
        let skin = Surface::new(&clip.body[t], &clip.body_faces);
        let mut own = baked.only(t);
        let truth = &clip.drape.frames[t];
        let mut pull = vec![1.0; truth.len()];
        let mut wanted = truth.clone();
        for _ in 0..ROUNDS {
            let mut deep = false;
            for (v, x) in own.frame(0).into_iter().enumerate() {
                let Some(c) = skin.closest(x, REACH) else {
                    continue;
                };
                let corners = clip.body_faces[c.face as usize];
                let is_covered = |i: &u32| covered.get(*i as usize).copied().unwrap_or(false);
                if c.signed < ROOM && !corners.iter().all(is_covered) {
                    deep = true;
                    pull[v] = PULL;
                    wanted[v] += (ROOM - c.signed) * c.normal;
                }
            }
            if !deep {
                break;
            }
            own.lead(0, (&wanted, &pull));
        }
        (own.moves.remove(0), own.codes.remove(0))
    };
    let led: Vec<_> = (0..frames).into_par_iter().map(one).collect();
    (baked.moves, baked.codes) = led.into_iter().unzip();
}

/// The vertices of a clip's skin that cloth covers in all frames.
pub fn covered(clip: &Clip) -> Vec<bool> {
    let n = clip.body.first().map_or(0, Vec::len);
    let garments: Vec<(Clip, Vec<bool>)> = (clip.garments().into_iter())
        .map(|(_, g)| {
            let rim = rim(&g);
            (g, rim)
        })
        .collect();
    let frames = clip.drape.frames.len();
    let looked = frames.min(LOOKED);
    let in_frame = |i: usize| {
        let t = i * frames / looked;
        let normals = vertex_normals(&clip.body[t], &clip.body_faces);
        let cloth: Vec<(Surface, &[bool])> = (garments.iter())
            .map(|(g, rim)| (Surface::new(&g.drape.frames[t], &g.drape.faces), &rim[..]))
            .collect();
        // Whether cloth is near a vertex, and whether it lies before it.
        let one = |v: usize| {
            let x = clip.body[t][v];
            let near = |(surface, rim): &(Surface, &[bool])| {
                let c = surface.closest(x, COVERED)?;
                let corners = surface.faces()[c.face as usize];
                let inner = corners.iter().all(|i| !rim[*i as usize]);
                inner.then(|| (c.point - x).dot(normals[v]) > 0.0)
            };
            let all = || cloth.iter().filter_map(near);
            [all().next().is_some(), all().any(|before| before)].map(usize::from)
        };
        (0..n).map(one).collect::<Vec<[usize; 2]>>()
    };
    let both = |mut a: Vec<[usize; 2]>, b: Vec<[usize; 2]>| {
        for (a, b) in a.iter_mut().zip(b) {
            *a = [a[0] + b[0], a[1] + b[1]];
        }
        a
    };
    let seen = (0..looked).into_par_iter().map(in_frame);
    let counts = seen.reduce(|| vec![[0; 2]; n], both);
    // Where skin meets skin, as in armpits, cloth may be behind it for a moment.
    let is_covered =
        |[near, before]: &[usize; 2]| *near == looked && *before as f64 >= MOSTLY * looked as f64;
    counts.iter().map(is_covered).collect()
}

/// Vertices within a few rings of an edge that only one triangle has.
fn rim(garment: &Clip) -> Vec<bool> {
    let faces = &garment.drape.faces;
    let mut uses = std::collections::HashMap::new();
    for f in faces {
        for (a, b) in [(f[0], f[1]), (f[1], f[2]), (f[2], f[0])] {
            *uses.entry((a.min(b), a.max(b))).or_insert(0) += 1;
        }
    }
    let mut rim = vec![false; garment.n_verts()];
    for ((a, b), n) in uses {
        if n == 1 {
            rim[a as usize] = true;
            rim[b as usize] = true;
        }
    }
    for _ in 1..HEM {
        let old = rim.clone();
        for f in faces {
            if f.iter().any(|i| old[*i as usize]) {
                f.iter().for_each(|i| rim[*i as usize] = true);
            }
        }
    }
    rim
}

/// How far a file is from the frames that it was made of.
pub struct Judged {
    /// For the report.
    pub report: Report,
    /// For people: what it is like, and what is wrong with it.
    pub told: String,
    pub warnings: Vec<String>,
    /// The clip with the file's cloth.
    pub shown: Clip,
}

/// Reads `bytes` back and holds them against `clip`.
pub fn judged(bytes: &[u8], clip: &Clip) -> Result<Judged, Failure> {
    let read = read_moving("the animation", bytes).map_err(|e| file_failure(&e))?;
    let pairs = clip.drape.frames.iter().zip(&read.drape.frames);
    let gap = |(a, b): (&Vec<DVec3>, &Vec<DVec3>)| -> Vec<f32> {
        let gaps = a.iter().zip(b).map(|(a, b)| a.distance(*b) as f32);
        gaps.collect()
    };
    let mut gaps: Vec<f32> = pairs.flat_map(gap).collect();
    gaps.sort_unstable_by(f32::total_cmp);
    let mm = |x: f32| round(f64::from(x) * 1e3);
    let at = |share: f64| gaps[((gaps.len() - 1) as f64 * share) as usize];
    let mean = gaps.iter().map(|x| f64::from(*x)).sum::<f64>() / gaps.len() as f64;
    // A character's own skin is not read; that which the cloth lies on is next to it.
    let (bodies, body_faces) = match read.body.is_empty() {
        false => (&read.body, &read.body_faces),
        true => (&clip.body, &clip.body_faces),
    };
    let frames = read.drape.frames.len();
    let both = (frames > 0).then(|| {
        let cloth = Surface::new(&read.drape.frames[0], &read.drape.faces);
        [cloth, Surface::new(&bodies[0], body_faces)]
    });
    let met = |both: &mut Option<[Surface; 2]>, t: usize| {
        let [cloth, skin] = both.as_mut().expect("there are frames");
        cloth.refit(&read.drape.frames[t]);
        skin.refit(&bodies[t]);
        [
            cloth.intersections(skin).len(),
            cloth.self_intersections().len(),
        ]
    };
    let all = (0..frames).into_par_iter();
    let met: Vec<[usize; 2]> = all.map_init(|| both.clone(), met).collect();
    let frames_with = |k: usize| met.iter().filter(|n| n[k] > 0).count();
    let most = |k: usize| met.iter().map(|n| n[k]).max().unwrap_or(0);
    let mut report = Report::default();
    report.set("off_mean_mm", round(mean * 1e3));
    report.set("off_p99_mm", mm(at(0.99)));
    report.set("off_most_mm", mm(at(1.0)));
    report.set("frames_through_shown_skin", frames_with(0));
    report.set("pairs_through_shown_skin", most(0));
    report.set("frames_through_itself", frames_with(1));
    report.set("pairs_through_itself", most(1));
    let told = format!(
        "{} frames with cloth in skin that is seen ({} pairs of triangles at most), {} with cloth in cloth ({}); up to {} mm off",
        frames_with(0),
        most(0),
        frames_with(1),
        most(1),
        mm(at(1.0))
    );
    let warning = (frames_with(0) + frames_with(1) > 0).then(|| {
        format!(
            "as baked {told}; more morphs or bones, or --bake frames, are nearer to what was found"
        )
    });
    let mut shown = clip.clone();
    shown.drape.frames = read.drape.frames;
    Ok(Judged {
        report,
        told,
        shown,
        warnings: warning.into_iter().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_to_bake_are_read_and_others_refused_by_name() {
        assert_eq!(Bake::parse("frames"), Ok(Bake::Frames));
        assert_eq!(Bake::parse("morphs"), Ok(Bake::Morphs(32)));
        assert_eq!(Bake::parse("bones:64"), Ok(Bake::Bones(64)));
        for bad in ["", "vat", "bones:0", "bones:251", "morphs:x", "frames:3"] {
            let told = Bake::parse(bad).expect_err(bad);
            assert!(told.contains("bones"), "{bad}: {told}");
        }
    }
}
