//! How good a simulation is, as far as that is cheap to tell.

use glam::DVec3;
use muslin_geom::{Mesh, Report, Surface, intersecting_pairs};
use muslin_io::Clip;
use muslin_sim::{BEYOND_LIMIT, stretch};
use rayon::prelude::*;

use crate::drape::percentile_99;
use crate::failure::{Exit, Failure};
use crate::hero::Hero;
use crate::table::Table;

use super::reel::Told;
use super::set::Set;

/// Flesh that gives way farther than this tells of a body that passes through itself [m].
const DEEP: f64 = 0.02;

/// One garment over all frames.
#[derive(Clone, Debug, Default)]
pub struct Strained {
    /// Its name.
    pub name: String,
    /// The largest stretch of any face in any frame (0.01 is 1 %).
    pub max: f64,
    /// The largest of the frames' 99th percentiles.
    pub p99: f64,
    /// Its fabric's limit.
    pub limit: Option<f64>,
    /// Frames with a face beyond the limit and one per cent.
    pub beyond: usize,
    /// Frames in which cloth meets the body and one face of this in a hundred is beyond the limit and one per cent.
    pub tight: usize,
    /// Whether it comes from a file, which knows no cuts.
    pub of_file: bool,
}

impl Strained {
    /// What gives it more room.
    fn room(&self) -> &'static str {
        match self.of_file {
            true => "a larger --size",
            false => "--cut loose",
        }
    }
}

/// All frames together.
#[derive(Clone, Debug, Default)]
pub struct Quality {
    /// Garment by garment.
    pub strained: Vec<Strained>,
    /// Pairs of the cloth's own triangles that cross, frame by frame, by exact predicates.
    pub crossings: Vec<usize>,
    /// What the simulator told of each frame.
    pub told: Vec<Told>,
    /// Frames that were reached once more.
    pub again: usize,
    /// Pairs of cloth and a character's own triangles that meet, frame by frame; none on our own body.
    pub shown: Vec<usize>,
}

impl Quality {
    /// Measures the frames as they are delivered.
    pub fn measure(set: &Set, clip: &Clip, (told, again): (Vec<Told>, usize)) -> Self {
        let frames = clip.drape.frames.par_iter();
        let faces = &set.cloth.faces;
        let start = clip.drape.frames.first();
        let cloth = start.map(|x| Surface::new(x, faces));
        let each: Vec<(Vec<[f64; 2]>, usize)> = frames
            .map_init(
                || cloth.clone(),
                |cloth, x| {
                    let all = stretch(faces, &set.cloth.rest, x);
                    let parts = clip.drape.parts.iter().map(|p| {
                        let of = all[p.faces.clone()].to_vec();
                        let max = of.iter().copied().fold(0.0, f64::max);
                        [max, percentile_99(of)]
                    });
                    let crossings = cloth.as_mut().map_or(0, |cloth| {
                        cloth.refit(x);
                        cloth.self_intersections().len()
                    });
                    (parts.collect(), crossings)
                },
            )
            .collect();
        let shown = |hero: &Hero| -> Vec<usize> {
            let pairs = clip.drape.frames.par_iter().zip(&clip.body).enumerate();
            let met = pairs.map(|(t, (x, skin))| {
                let mesh = |verts: Vec<DVec3>, faces: &[[u32; 3]]| Mesh {
                    verts,
                    faces: faces.to_vec(),
                };
                let own = mesh(set.hero_at(hero, (t, skin)), &hero.character.faces);
                intersecting_pairs(&mesh(x.clone(), faces), &own).len()
            });
            met.collect()
        };
        let named = set.outfit.pieces.iter().zip(set.outfit.names());
        let strained = named.enumerate().map(|(k, (piece, name))| {
            let of = |i: usize| each.iter().map(move |e| e.0[k][i]);
            let limit = piece.fabric.strain_limit;
            let is_beyond = |x: &f64| limit.is_some_and(|l| *x > l + BEYOND_LIMIT);
            let is_tight =
                |t: &usize| told[*t].body_intersections > 0.0 && is_beyond(&each[*t].0[k][1]);
            Strained {
                of_file: piece.sha256.is_some(),
                tight: (0..each.len().min(told.len())).filter(is_tight).count(),
                name,
                max: of(0).fold(0.0, f64::max),
                p99: of(1).fold(0.0, f64::max),
                limit,
                beyond: of(0).filter(is_beyond).count(),
            }
        });
        Self {
            strained: strained.collect(),
            crossings: each.iter().map(|e| e.1).collect(),
            told,
            again,
            shown: set.hero.map(shown).unwrap_or_default(),
        }
    }

    /// What keeps the frames from being delivered, if anything.
    pub fn fault(&self, allow_crossings: bool) -> Option<Failure> {
        let count = |is: &dyn Fn(usize) -> bool| (0..self.told.len()).filter(|&i| is(i)).count();
        let in_body = count(&|i| self.told[i].body_intersections > 0.0);
        let in_cloth = count(&|i| self.crossings[i] > 0);
        let of = self.told.len();
        let (code, what) = match (in_body, in_cloth) {
            _ if allow_crossings => return None,
            (0, 0) => return None,
            (0, n) => (
                "cloth-in-cloth",
                format!("the cloth crosses itself in {n} of {of} frames"),
            ),
            (n, _) => (
                "cloth-in-body",
                format!("cloth meets the body in {n} of {of} frames"),
            ),
        };
        let mut hint =
            "nothing is lost: --resume --allow-crossings writes the frames all the same; "
                .to_owned();
        match self.strained.iter().max_by_key(|s| s.tight) {
            Some(s) if s.tight > 0 => {
                hint += &format!(
                    "{} is too narrow for the body in {} of them: try {}, or a fabric that gives",
                    s.name,
                    s.tight,
                    s.room()
                )
            }
            outermost => {
                let room = outermost.map_or("--cut loose", Strained::room);
                hint += &format!("{room} or a finer --edge may avoid it");
            }
        }
        Some(Failure::new(Exit::Quality, code, what).hint(hint))
    }

    /// What the user should know; `can_cut`: whether garments can be asked for in another cut.
    pub fn warnings(&self, fps: f64, can_cut: bool) -> Vec<String> {
        let mut out = Vec::new();
        let deep = |t: &Told| t.yielded > DEEP;
        if let Some(first) = self.told.iter().position(deep) {
            let n = self.told.iter().filter(|t| deep(t)).count();
            let worst = self.told.iter().map(|t| t.yielded).fold(0.0, f64::max);
            out.push(format!(
                "the body passes through itself in {n} frames, first at {:.2} s; its flesh gave way by {:.0} mm to make room for the cloth",
                first as f64 / fps,
                worst * 1e3
            ));
        }
        for s in self.strained.iter().filter(|s| s.beyond > 0) {
            out.push(format!(
                "{} is stretched beyond its fabric's limit of {:.1} % in {} frames, to {:.1} % at worst; try {}",
                s.name,
                s.limit.unwrap_or(f64::NAN) * 100.0,
                s.beyond,
                s.max * 100.0,
                if can_cut { s.room() } else { "a larger --size" }
            ));
        }
        let met = self.shown.iter().filter(|n| **n > 0).count();
        if met > 0 {
            out.push(format!(
                "cloth passes through the character's own triangles in {met} frames, in {} places at most: what stands off its body is not seen by the cloth",
                self.shown.iter().max().unwrap_or(&0)
            ));
        }
        out
    }

    /// Middle and longest time of a frame [ms]; the first is not counted where there are others: it has the lead-in.
    pub fn pace(&self) -> [f64; 2] {
        let first = usize::from(self.told.len() > 1);
        let laps = self.told.iter().skip(first).map(|t| t.seconds * 1e3);
        let mut laps: Vec<f64> = laps.collect();
        laps.sort_unstable_by(f64::total_cmp);
        let middle = laps.get(laps.len() / 2).copied().unwrap_or(f64::NAN);
        [middle, laps.last().copied().unwrap_or(f64::NAN)]
    }

    /// How many frames something is true of.
    pub fn frames_with(&self, is: impl Fn(&Told) -> bool) -> usize {
        self.told.iter().filter(|t| is(t)).count()
    }

    /// How many frames have cloth in the body, and how many cloth in cloth.
    pub fn faulty(&self) -> [usize; 2] {
        let touching = self.frames_with(|t| t.body_intersections > 0.0);
        let crossed = self.crossings.iter().filter(|n| **n > 0).count();
        [touching, crossed]
    }

    /// The line of the cloth stage.
    pub fn line(&self) -> String {
        let [touching, crossed] = self.faulty();
        let [median, _] = self.pace();
        format!(
            "{} frames, {median:.0} ms each by the median; {touching} with cloth in the body, {crossed} in itself, {} solved again",
            self.told.len(),
            self.again,
        )
    }

    /// What the last words say of contact.
    pub fn contact(&self) -> String {
        let [touching, crossed] = self.faulty();
        let again = self.again;
        let yielded = self.told.iter().map(|t| t.yielded).fold(0.0, f64::max) * 1e3;
        let gave = match yielded < 0.5 {
            true => String::new(),
            false => format!("; skin gave way by up to {yielded:.0} mm"),
        };
        format!(
            "{touching} frames with cloth in the body, {crossed} with cloth in cloth; {again} solved again{gave}"
        )
    }

    /// What meets what, in rows of a table; `baked`: what the file is like that was made of the frames, if it does not
    /// hold them as they are.
    pub fn tell_contact(&self, table: &mut Table, baked: Option<String>) {
        match baked {
            None => {
                table.row(["contact", &self.contact()]);
            }
            Some(told) => {
                table.row([
                    "contact",
                    &format!("before it was baked {}", self.contact()),
                ]);
                table.row(["baked", &told]);
            }
        }
    }

    /// The figures for the report.
    pub fn report(&self) -> Report {
        let mut r = Report::default();
        let [touching, crossed] = self.faulty();
        let most = self.told.iter().map(|t| t.body_intersections);
        r.set("frames_with_body_intersections", touching);
        r.set("body_intersections_max", most.fold(0.0, f64::max));
        r.set("frames_with_self_crossings", crossed);
        r.set(
            "self_crossings_max",
            self.crossings.iter().copied().max().unwrap_or(0),
        );
        r.set("frames_solved_again", self.again);
        if !self.shown.is_empty() {
            let met = self.shown.iter().filter(|n| **n > 0).count();
            r.set("frames_with_character_intersections", met);
            let most = self.shown.iter().copied().max().unwrap_or(0);
            r.set("character_intersections_max", most);
        }
        let mut all = Report::default();
        for s in &self.strained {
            all.set(&s.name, s.report());
        }
        r.set("stretch", all);
        let yielded = self.told.iter().map(|t| t.yielded).fold(0.0, f64::max);
        r.set("flesh_yielded_mm", round(yielded * 1e3));
        r.set(
            "frames_with_flesh_yielded_20_mm",
            self.frames_with(|t| t.yielded > DEEP),
        );
        r.set("steps", self.told.iter().map(|t| t.steps).sum::<f64>());
        let [median, worst] = self.pace().map(round);
        r.set("frame_median_ms", median)
            .set("frame_worst_ms", worst);
        r
    }
}

impl Strained {
    fn report(&self) -> Report {
        let mut r = Report::default();
        r.set("max_percent", round(self.max * 100.0));
        r.set("p99_percent", round(self.p99 * 100.0));
        if let Some(limit) = self.limit {
            r.set("limit_percent", round(limit * 100.0));
            r.set("frames_beyond_limit", self.beyond);
        }
        r
    }
}

/// To two decimals, so that reports read well.
pub fn round(x: f64) -> f64 {
    (x * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quality(body: f64, crossings: usize, yielded: f64) -> Quality {
        let told = |body_intersections| Told {
            yielded,
            body_intersections,
            steps: 4.0,
            seconds: 0.1,
        };
        Quality {
            crossings: vec![0, crossings],
            told: vec![told(0.0), told(body)],
            ..Quality::default()
        }
    }

    #[test]
    fn what_meets_stops_delivery_unless_allowed() {
        let code = |q: Quality, allow| q.fault(allow).map(|f| (f.code, f.exit));
        assert_eq!(code(quality(0.0, 0, 0.0), false), None);
        assert_eq!(
            code(quality(0.0, 2, 0.0), false),
            Some(("cloth-in-cloth", Exit::Quality))
        );
        assert_eq!(
            code(quality(3.0, 2, 0.0), false),
            Some(("cloth-in-body", Exit::Quality))
        );
        assert_eq!(code(quality(3.0, 2, 0.0), true), None);
    }

    #[test]
    fn a_garment_that_is_too_narrow_is_named_with_what_widens_it() {
        let tight = |of_file| Strained {
            name: "dress".into(),
            tight: 3,
            of_file,
            ..Strained::default()
        };
        let hint = |strained| {
            let caught = Quality {
                strained,
                ..quality(3.0, 0, 0.0)
            };
            caught.fault(false).expect("it meets the body").hint
        };
        let tee = Strained::default();
        let told = hint(vec![tee.clone(), tight(true)]);
        let says = |told: &str, what: &str| assert!(told.contains(what), "{told}");
        says(
            &told,
            "dress is too narrow for the body in 3 of them: try a larger --size",
        );
        says(&hint(vec![tight(false)]), "try --cut loose");
        says(&hint(vec![tee]), "--cut loose or a finer --edge");
    }

    #[test]
    fn a_body_that_passes_through_itself_is_told_with_its_time() {
        assert!(quality(0.0, 0, 0.019).warnings(60.0, true).is_empty());
        let told = quality(0.0, 0, 0.031).warnings(60.0, true);
        assert!(
            told[0].contains("2 frames, first at 0.00 s") && told[0].contains("31 mm"),
            "{told:?}"
        );
    }
}
