//! Trained garments on recordings they never learnt from: the network, refined, and the minimiser.

use std::path::{Path, PathBuf};
use std::slice;

use glam::DVec3;
use muslin_body::Avatar;
use muslin_geom::{Mesh, self_intersections};
use muslin_io::Clip;
use muslin_model::{Crowd, CrowdError, Model, Player};
use muslin_sim::{Cloth, Settled};
use rayon::prelude::*;

use super::clock::{least_of, load};
use super::{fabrics, needed, sphere, swing};
use crate::anew::refined;
use crate::animate::{
    along, as_trained, fits, model_failure, predict, read_model, wants_character,
};
use crate::dress::asked_figure;
use crate::evaluate::evaluate;
use crate::evaluate::solver::{CONVERGED, energies};
use crate::failure::{Exit, Failure};
use crate::hero::{Hero, avatar_of};
use crate::options::DressOptions;
use crate::outfit::Outfit;
use crate::simulate::SimulateOptions;
use crate::simulate::motion;
use crate::simulate::reel::{Reel, Told};
use crate::simulate::set::Set;
use crate::swings;
use crate::table::Table;
use crate::watch::Watch;

/// Recordings that nothing which ships may learn from.
pub const HELD_OUT: [&str; 3] = [
    "motion/cmu-bvh/02_01_walk.bvh",
    "motion/cmu-bvh/05_06_dance-modern.bvh",
    "motion/cmu-bvh/01_01_playground_forward-jumps_turn.bvh",
];
/// Solver iterations of the refined tier.
pub(super) const REFINE: usize = 5;
/// Frames that the refined tier was led through up to one that is looked at: half a run of them.
const LONG: usize = 15;

/// Frames of a recording in a second that are looked at, for those inside the body and to choose
/// from.
const LOOKS: f64 = 5.0;

/// One way to lay the cloth, over all frames of a clip.
#[derive(Default)]
struct Tier {
    /// Stretch, bending and weight of each frame, in the garment's own fabric [J].
    energies: Vec<[f64; 3]>,
    reel: Reel,
    body_pairs: usize,
    crossings: usize,
}

impl Tier {
    fn add(&mut self, cloth: &Cloth, (x, body): (&[DVec3], &[DVec3])) {
        self.energies.push(energies(cloth, x));
        self.crossings += crossings(&cloth.faces, x);
        let told = Told {
            yielded: 0.0,
            body_intersections: 0.0,
            steps: 0.0,
            seconds: 0.0,
        };
        self.reel.push(x, body, told);
    }

    fn settled(&mut self, cloth: &Cloth, s: &Settled) {
        self.add(cloth, (&s.verts, &s.body));
        self.body_pairs += s.body_intersections;
    }

    /// Strain [J] of the reference cloth, by the judge of all clips.
    fn strain(&self, set: &Set) -> Result<f64, Failure> {
        let clip: Clip = set.clip(self.reel.clone());
        Ok(evaluate(&clip, None)?.figure("energies", "strain_J"))
    }
}

/// Who wears it: our own body, or the likeness of a character.
pub(super) type Wearer<'a> = (&'a Avatar, Option<&'a Hero>);

/// A model that is measured.
struct Subject {
    path: PathBuf,
    model: Model,
}

impl Subject {
    fn new(path: &Path) -> Result<Self, Failure> {
        Ok(Self {
            path: path.to_owned(),
            model: read_model(path)?,
        })
    }

    fn name(&self) -> String {
        muslin_io::name(Path::new(self.path.file_stem().unwrap_or_default()))
    }

    fn note(&self, name: &str) -> &str {
        self.model.notes.get(name).map_or("unknown", String::as_str)
    }

    /// Frames a second that it is played at, and which of them are looked at: those of
    /// [`LOOKS`], whatever the rate.
    fn rate(&self) -> (f64, usize) {
        let taught = self.note("fps").parse().unwrap_or(30.0);
        match self.model.encoder.is_moving() {
            true => (taught, (taught / LOOKS).round().max(1.0) as usize),
            false => (30.0, (30.0 / LOOKS).round() as usize),
        }
    }

    /// What it is, in a line.
    fn told(&self) -> String {
        let bytes = std::fs::metadata(&self.path).map_or(0, |m| m.len());
        format!(
            "{}: {} in {}, {} vertices, {:.2} MB, {} codes of {}, trained on {}",
            self.path.display(),
            self.note("garment"),
            self.note("fabric"),
            self.model.n_verts(),
            bytes as f64 / 1e6,
            self.model.n_codes(),
            self.model.encoder.name(),
            match self.note("trained_on").split("; ").count() {
                1 => "one motion".to_owned(),
                n => format!("{n} motions"),
            },
        )
    }
}

/// What is measured of trained garments, and on whom.
#[derive(Clone, Debug, Default)]
pub struct Trials {
    /// Models, side by side.
    pub models: Vec<PathBuf>,
    /// Frames in all for each.
    pub cases: usize,
    /// Body, size and fabric where they are others than those that were taught.
    pub worn: DressOptions,
    /// Only parts whose name ("tee, 02_01_walk, swing") holds one of these; all if empty.
    pub only: Vec<String>,
}

/// What a part of the trials measures.
#[derive(Clone, Copy)]
enum Kind {
    /// A clip, as if the body stood still in every frame.
    Rest(&'static str),
    /// A clip, with how cloth swings.
    Swing(&'static str),
    /// One motion in several fabrics.
    Fabrics,
    /// Frames a second.
    Speed,
}

impl Kind {
    fn all() -> impl Iterator<Item = Self> {
        let clips = HELD_OUT.map(Self::Rest).into_iter();
        let clips = clips.chain(HELD_OUT.map(Self::Swing));
        clips.chain([Self::Fabrics, Self::Speed])
    }

    fn name(self) -> &'static str {
        match self {
            Self::Rest(_) => "rest",
            Self::Swing(_) => "swing",
            Self::Fabrics => "fabrics",
            Self::Speed => "speed",
        }
    }

    /// Whether it can be told of a model.
    fn fits(self, model: &Model) -> bool {
        match self {
            Self::Swing(_) => swings::are_ours(model) || model.has_motion_level(),
            Self::Fabrics => fabrics::knows_any(model),
            Self::Rest(_) | Self::Speed => true,
        }
    }
}

/// The figures of trained garments, the recordings being in the data folder; `watch` hears of each part
/// as soon as it is measured.
pub fn garments(
    data: Option<&Path>,
    trials: &Trials,
    watch: &mut Watch,
) -> Result<String, Failure> {
    let named = |name: &str| trials.only.iter().any(|o| name.contains(o));
    let on_sphere = trials.only.is_empty() || named(sphere::NAME);
    let alone = trials.models.is_empty() && named(sphere::NAME);
    let data = if alone { Path::new("") } else { needed(data)? };
    if trials.models.is_empty() && !alone {
        let fault = Failure::new(Exit::Usage, "no-model", "no model to measure");
        return Err(fault.hint("name one with --model; `muslin train` makes it"));
    }
    let subjects = trials.models.iter().map(|p| Subject::new(p));
    let subjects = subjects.collect::<Result<Vec<_>, _>>()?;
    let hero = Hero::load(&trials.worn)?;
    let avatar = &avatar_of(hero.as_ref())?;
    let who: Wearer = (avatar, hero.as_ref());
    for subject in &subjects {
        wants_character(&subject.model, who.1.is_some())?;
    }
    if let (None, Some(told)) = (fabric_of(&trials.worn), differing(&subjects)) {
        watch.warn(&told);
    }
    let parts = parts(&subjects, &trials.only);
    if parts.is_empty() && !on_sphere {
        let what = format!(
            "no part of the figures is called {:?}",
            trials.only.join(", ")
        );
        let fault = Failure::new(Exit::Usage, "no-part", what);
        return Err(fault
            .at("--only")
            .hint("they are called like \"tee, 02_01_walk, swing\""));
    }
    let worn = &trials.worn;
    let [mut rest, mut motion, mut cloths, mut discs] =
        [&HEADS[..], &swing::HEADS, &fabrics::HEADS, &sphere::HEADS].map(Table::new);
    let mut rates = Vec::new();
    let n = trials.cases.div_ceil(HELD_OUT.len());
    let count = parts.len() + usize::from(on_sphere);
    for (done, (name, subject, kind)) in parts.iter().enumerate() {
        watch.progress(name);
        let (of, own) = ((who, &subject.model), subject.name());
        let told = match kind {
            Kind::Rest(clip) => {
                let names = [clip_name(clip), own];
                let names = names.each_ref().map(String::as_str);
                at_rest(
                    (who, subject),
                    (&data.join(clip), worn, names),
                    n,
                    &mut rest,
                )?
            }
            Kind::Swing(clip) => {
                let names = [clip_name(clip), own];
                let names = names.each_ref().map(String::as_str);
                swing::rows(of, (&data.join(clip), worn, names), &mut motion)?
            }
            Kind::Fabrics => fabrics::rows(of, (worn, &own), &mut cloths)?,
            Kind::Speed => {
                let told = speed(of, (&data.join(HELD_OUT[0]), worn))?;
                rates.push(format!("{}\n{told}", subject.told()));
                told
            }
        };
        let told = format!("{name}: {told}");
        watch.done((done + 1, count), kind.name(), told)?;
    }
    if on_sphere {
        let told = sphere::rows(&mut discs, watch)?;
        watch.done((count, count), "sphere", told)?;
    }
    let tables = [rest, motion, cloths, discs].map(|t| t.text());
    let shown = tables.iter().filter(|t| t.contains('\n'));
    let mut out: Vec<String> = shown.cloned().collect();
    out.push(rates.join("\n"));
    Ok(format!(
        "{}\n{}\n\
         strain: StVK of the reference cloth; gap: stretch, bending and weight in the garment's own \
         fabric above\nthe solver after {CONVERGED} more iterations; crossings and pairs are a frame's mean, by exact predicates\n\
         swing: how cloth moves beyond where the network says that it rests; alike: 1 where it is the simulator's; turned \
         about:\nhow far a vertex is at most from where it is if body and motion are turned about the vertical",
        out.join("\n\n"),
        load(),
    ))
}

/// The fabric that all are measured in, where one is asked for.
fn fabric_of(worn: &DressOptions) -> Option<&str> {
    worn.outfit.first()?.fabric.as_deref()
}

/// What is to be said where models are of different fabrics.
fn differing(subjects: &[Subject]) -> Option<String> {
    let first = subjects.first()?.note("fabric");
    subjects.iter().find(|s| s.note("fabric") != first).map(|other| {
        format!(
            "models of different fabrics ({first}, {}): each is measured in its own, and what stiff cloth costs \
             is not to be held against soft cloth; --fabric names one for all",
            other.note("fabric")
        )
    })
}

/// What is to be measured, as far as it was asked for, by name.
fn parts<'s>(subjects: &'s [Subject], only: &[String]) -> Vec<(String, &'s Subject, Kind)> {
    let name = |s: &Subject, kind: Kind| match kind {
        Kind::Rest(clip) | Kind::Swing(clip) => {
            format!("{}, {}, {}", s.name(), clip_name(clip), kind.name())
        }
        Kind::Fabrics | Kind::Speed => format!("{}, {}", s.name(), kind.name()),
    };
    let of = |kind| subjects.iter().map(move |s| (name(s, kind), s, kind));
    let asked = |name: &str| only.is_empty() || only.iter().any(|o| name.contains(o));
    let all = Kind::all().flat_map(of);
    all.filter(|(name, s, kind)| kind.fits(&s.model) && asked(name))
        .collect()
}

/// Heads of the table of cloth at rest.
const HEADS: [&str; 11] = [
    "clip",
    "model",
    "fabric",
    "tier",
    "strain J",
    "gap J",
    "of stretch, bending, weight",
    "inside %",
    "body pairs",
    "crossings",
    "frames",
];

/// What a clip is called.
fn clip_name(clip: &str) -> String {
    muslin_io::name(Path::new(Path::new(clip).file_stem().unwrap_or_default()))
}

/// Adds the rows of a clip: `n` frames of it, each as if the body stood still in it; returns them in short.
fn at_rest(
    (who, subject): (Wearer, &Subject),
    (clip, worn, names): (&Path, &DressOptions, [&str; 2]),
    n: usize,
    table: &mut Table,
) -> Result<String, Failure> {
    // What rests is compared with what rests: our own models without their swings.
    let model = &Model {
        sway: None,
        ..subject.model.clone()
    };
    let (fps, every) = subject.rate();
    let set = set((who, model), (clip, fps, worn), None)?;
    let model = &set.told(0, model.clone())?;
    let raw = predict((&set, slice::from_ref(model)), (1.0, every))?;
    let plain = Model {
        modes: vec![0.0; model.modes.len()],
        ..model.clone()
    };
    let skinned = predict((&set, slice::from_ref(&plain)), (1.0, every))?;
    let all = raw.frames.len();
    let mut tiers: [Tier; 4] = Default::default();
    let frames: Vec<usize> = (0..n).map(|i| (2 * i + 1) * all / (2 * n)).collect();
    let solve = |k: &usize| {
        let body = set.frame(set.moving.lead + k);
        let first = (k + 1).saturating_sub(LONG);
        let way = (first, &raw.frames[first..=*k], None);
        let near = along((&set, REFINE, 0.0), way, &mut Watch::nobody())?.pop();
        let near = near.expect("the way ends in this frame");
        let rest = refined(&set, &near.cloth, (&body, CONVERGED))?;
        Ok((*k, body, near, rest))
    };
    let solved: Result<Vec<_>, Failure> = frames.par_iter().map(solve).collect();
    for (k, body, near, rest) in solved? {
        tiers[0].add(&set.cloth, (&skinned.frames[k], &body.skin));
        tiers[1].add(&set.cloth, (&raw.frames[k], &body.skin));
        tiers[2].add(&set.cloth, (&near.cloth, &near.body));
        tiers[2].body_pairs += near.told.body_intersections as usize;
        tiers[3].settled(&set.cloth, &rest);
    }
    let inside = [Some(skinned.inside), Some(raw.inside), None, None];
    let mut short = Vec::new();
    for (t, (tier, inside)) in tiers.iter().zip(inside).enumerate() {
        let gaps = tier.energies.iter().zip(&tiers[3].energies);
        let gaps = gaps.fold([0.0; 3], |sum, (a, b)| {
            [0, 1, 2].map(|i| sum[i] + (a[i] - b[i]) / n as f64)
        });
        let gap: f64 = gaps.iter().sum();
        let mean = |x: usize| format!("{:.2}", x as f64 / n as f64);
        let first = |x: &str| if t == 0 { x.to_owned() } else { String::new() };
        let [strain, gap] = [tier.strain(&set)?, gap].map(|x| format!("{x:.4}"));
        short.push(format!("{} {strain} J, {gap} above", TIERS[t]));
        table.row([
            first(names[0]),
            first(names[1]),
            first(fabric_of(worn).unwrap_or(subject.note("fabric"))),
            TIERS[t].to_owned(),
            strain,
            gap,
            gaps.map(|x| format!("{x:.4}")).join(" "),
            inside.map_or(String::new(), |i| format!("{i:.3}")),
            if t < 2 {
                String::new()
            } else {
                mean(tier.body_pairs)
            },
            mean(tier.crossings),
            n.to_string(),
        ]);
    }
    Ok(short[1..3].join("; "))
}

/// Ways to lay the cloth.
const TIERS: [&str; 4] = ["skinned", "network", "refined", "minimiser"];

/// A model's garment and body on a clip, or on its first seconds.
pub(super) fn set<'a>(
    (who, model): (Wearer<'a>, &Model),
    (clip, fps, worn): (&Path, f64, &DressOptions),
    seconds: Option<f64>,
) -> Result<Set<'a>, Failure> {
    let options = SimulateOptions {
        seconds,
        dress: worn.clone(),
        motion: clip.to_string_lossy().into_owned(),
        fps,
        ..SimulateOptions::default()
    };
    let options = as_trained(slice::from_ref(model), &options)?;
    let (figure, ..) = asked_figure(who.0, &options.dress)?;
    let moving = motion::load(who, &figure, &options)?;
    let outfit = Outfit::make_for(who, &options.dress, |_| {})?;
    let mut set = Set::rested(who.0, figure, moving, outfit)?;
    set.hero = who.1;
    fits(model, &set.outfit.pieces[0].garment)?;
    Ok(set)
}

/// Moments of a clip that a rate is measured over: standing still, nothing swings.
const MANY: usize = 32;
/// Moments a second.
const RATE: f64 = 30.0;

/// Frames a second of the network alone through a clip, swings included.
fn speed(
    (who, model): (Wearer, &Model),
    (clip, worn): (&Path, &DressOptions),
) -> Result<String, Failure> {
    let avatar = who.0;
    let set = &set((who, model), (clip, RATE, worn), Some(1.5))?;
    let model = &swing::swung(set, model)?;
    let mut player = Player::new(model, avatar).map_err(|e| model_failure(&e))?;
    let moments = &set.moving.motion.poses[set.moving.lead..];
    let poses: Vec<_> = moments.iter().cycle().take(MANY).collect();
    let bones: Vec<_> = (poses.iter())
        .map(|p| avatar.bones(&set.figure, p))
        .collect();
    let all: Vec<_> = (poses.iter().copied())
        .zip(bones.iter().map(Vec::as_slice))
        .collect();
    let n = player.n_verts();
    let [mut out, mut normals] = [(); 2].map(|()| vec![[0.0f32; 3]; MANY * n]);
    // Moments a second of one way to play them all.
    let mut rate = |play: &mut dyn FnMut(&mut Player)| {
        let time = least_of(10, || {
            player.begin(RATE.recip());
            play(&mut player);
        });
        1e3 * MANY as f64 / time.wall
    };
    let alone = rate(&mut |player| {
        for ((pose, bones), out) in all.iter().zip(out.chunks_mut(n)) {
            player.frame(pose, bones, out);
        }
    });
    let turned = rate(&mut |player| {
        let rooms = out.chunks_mut(n).zip(normals.chunks_mut(n));
        for ((pose, bones), rooms) in all.iter().zip(rooms) {
            player.frame_with_normals(pose, bones, rooms);
        }
    });
    let with_bones = rate(&mut |player| {
        for (pose, out) in poses.iter().zip(out.chunks_mut(n)) {
            let bones = avatar.bones(&set.figure, pose);
            player.frame(pose, &bones, out);
        }
    });
    let together = rate(&mut |player| player.frames(&all, &mut out));
    let turned_together =
        rate(&mut |player| player.frames_with_normals(&all, (&mut out, &mut normals)));
    Ok(format!(
        "network, swings, shapes and skinning on one core: {alone:.0} frames a second, {MANY} together {together:.0}; with normals {turned:.0} and {turned_together:.0}; with the posed bones but no normals {with_bones:.0}; {}; refined by {REFINE} on all cores {:.1}",
        crowds(model, set)?,
        refined_rate((who, model), (clip, worn))?
    ))
}

/// Wearers of a crowd on cores and on a device, and moments that they are told at once.
const CROWDS: [usize; 2] = [64, 1024];
const MOMENTS: usize = 4;

/// Frames a second of crowds, with normals: on all cores, and on a CUDA device where there is one.
fn crowds(model: &Model, set: &Set) -> Result<String, Failure> {
    let poses = &set.moving.motion.poses[set.moving.lead..];
    let bones: Vec<_> = (poses.iter())
        .map(|p| set.avatar.bones(&set.figure, p))
        .collect();
    let rate = |crowd: Result<Crowd, CrowdError>, wearers: usize| {
        let mut crowd = crowd?;
        // Everybody is somewhere else in the clip.
        let all: Vec<_> = (0..MOMENTS * wearers)
            .map(|k| (k / wearers + 7 * (k % wearers)) % poses.len())
            .map(|k| (&poses[k], &bones[k][..]))
            .collect();
        crowd.play(&all)?;
        let mut failed = None;
        let least = least_of(5, || failed = crowd.play(&all).err().or(failed.take()));
        let told = format!(
            "a crowd of {wearers} on {} {:.0}",
            crowd.place(),
            1e3 * all.len() as f64 / least.wall
        );
        failed.map_or(Ok(told), Err)
    };
    let [few, many] = CROWDS;
    let cores = Crowd::on_cores(model, set.avatar, few).map_err(|e| model_failure(&e))?;
    let cores = rate(Ok(cores), few).expect("cores do not fail");
    Ok(match rate(Crowd::on_cuda(model, set.avatar, many), many) {
        Ok(device) => format!("{cores}, {device}"),
        Err(why) => format!("{cores} ({why})"),
    })
}

/// Frames a second of the refined tier, as it is delivered one after the other; what leads to the first is left out.
fn refined_rate(
    (who, model): (Wearer, &Model),
    (clip, worn): (&Path, &DressOptions),
) -> Result<f64, Failure> {
    let set = &set((who, model), (clip, RATE, worn), Some(1.0))?;
    let raw = predict((set, slice::from_ref(model)), (1.0, usize::MAX))?.frames;
    let inertia = f64::from(u8::from(swings::are_ours(model)));
    let lead = |n: usize| {
        along(
            (set, REFINE, inertia),
            (0, &raw[..n], None),
            &mut Watch::nobody(),
        )
    };
    lead(1)?;
    let [first, all] = [1, raw.len()].map(|n| least_of(2, || lead(n)).wall);
    Ok(1e3 * (raw.len() - 1) as f64 / (all - first))
}

fn crossings(faces: &[[u32; 3]], x: &[DVec3]) -> usize {
    let mesh = Mesh {
        verts: x.to_vec(),
        faces: faces.to_vec(),
    };
    self_intersections(&mesh).len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named() {
        let none = Trials::default();
        let fault = garments(None, &none, &mut Watch::nobody()).expect_err("no data");
        assert_eq!(fault.code, "no-data");
        let here = Some(Path::new("."));
        let fault = garments(here, &none, &mut Watch::nobody()).expect_err("no model");
        assert_eq!((fault.code, fault.exit), ("no-model", Exit::Usage));
    }
}
