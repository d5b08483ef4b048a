//! Trained garments on recordings they never learnt from: the network, refined, and the minimiser.

use std::path::{Path, PathBuf};

use glam::DVec3;
use muslin_body::Avatar;
use muslin_energy::{RestTriangle, flat, hinge, membrane, point};
use muslin_geom::{Mesh, Value, self_intersections};
use muslin_io::Clip;
use muslin_model::{Model, Player};
use muslin_sim::{Cloth, Settled};
use rayon::prelude::*;

use super::clock::{least_of, load};
use super::{fabrics, needed, swing};
use crate::animate::{along, as_trained, fits, model_failure, predict, read_model, refined};
use crate::dress::asked_shape;
use crate::evaluate::evaluate;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
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
/// Iterations that lead from there to the minimiser.
const CONVERGED: usize = 120;

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
        let found = evaluate(&clip, None)?;
        match found.report.get("energies") {
            Some(Value::Tree(e)) => match e.get("strain_J") {
                Some(Value::Number(x)) => Ok(*x),
                _ => Ok(f64::NAN),
            },
            _ => Ok(f64::NAN),
        }
    }
}

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

/// The figures of the `models` on recordings of the data folder, side by side, `cases` frames in
/// all for each; on the body and in the fabric of `worn`, where it says so, else as they were taught.
pub fn garments(
    data: Option<&Path>,
    models: &[PathBuf],
    (cases, worn): (usize, &DressOptions),
    watch: &mut Watch,
) -> Result<String, Failure> {
    let data = needed(data)?;
    if models.is_empty() {
        let fault = Failure::new(Exit::Usage, "no-model", "no model to measure");
        return Err(fault.hint("name one with --model; `muslin train` makes it"));
    }
    let subjects = models.iter().map(|p| Subject::new(p));
    let subjects = subjects.collect::<Result<Vec<_>, _>>()?;
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let mut table = Table::new(&[
        "clip",
        "model",
        "tier",
        "strain J",
        "gap J",
        "inside %",
        "body pairs",
        "crossings",
        "frames",
    ]);
    let mut motion = Table::new(&swing::HEADS);
    let mut rates = vec![String::new(); subjects.len()];
    for clip in HELD_OUT {
        let n = cases.div_ceil(HELD_OUT.len());
        for (k, subject) in subjects.iter().enumerate() {
            let name = clip_name(clip, k == 0);
            watch.progress(&format!("{}: {}", subject.name(), clip_name(clip, true)));
            let at = &data.join(clip);
            rates[k] = one_clip((&avatar, subject), (at, worn, name.clone()), n, &mut table)?;
            if swings::are_ours(&subject.model) {
                let names = [name.as_str(), &subject.name()];
                watch.progress(&format!("{}: how it swings", subject.name()));
                swing::rows((&avatar, &subject.model), (at, worn, names), &mut motion)?;
            }
        }
    }
    let mut cloths = Table::new(&fabrics::HEADS);
    for subject in &subjects {
        let name = subject.name();
        watch.progress(&format!("{name}: in other fabrics"));
        fabrics::rows((&avatar, &subject.model), (worn, &name), &mut cloths)?;
    }
    let lines = subjects.iter().zip(rates);
    let lines: Vec<String> = lines.map(|(s, r)| format!("{}\n{r}", s.told())).collect();
    Ok(format!(
        "{}\n\n{}\n\n{}\n\n{}\n{}\n\
         strain: StVK of the reference cloth; gap: stretch, bending and weight in the garment's own \
         fabric above\nthe solver after {CONVERGED} more iterations; crossings and pairs are a frame's mean, by exact predicates\n\
         swing: how cloth moves beyond where the network says that it rests; alike: 1 where it is the simulator's",
        table.text(),
        motion.text(),
        cloths.text(),
        lines.join("\n"),
        load(),
    ))
}

/// What a clip is called in the table, where it is named.
fn clip_name(clip: &str, is_first: bool) -> String {
    let stem = Path::new(clip).file_stem().unwrap_or_default();
    match is_first {
        true => muslin_io::name(Path::new(stem)),
        false => String::new(),
    }
}

fn one_clip(
    (avatar, subject): (&Avatar, &Subject),
    (clip, worn, name): (&Path, &DressOptions, String),
    n: usize,
    table: &mut Table,
) -> Result<String, Failure> {
    // What rests is compared with what rests: our own models without their swings.
    let model = &Model {
        sway: None,
        ..subject.model.clone()
    };
    let (fps, every) = subject.rate();
    let set = set((avatar, model), (clip, fps, worn), None)?;
    let model = &set.told(model.clone())?;
    let raw = predict((&set, model), (1.0, every))?;
    let plain = Model {
        modes: vec![0.0; model.modes.len()],
        ..model.clone()
    };
    let skinned = predict((&set, &plain), (1.0, every))?;
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
    let names = ["skinned", "network", "refined", "minimiser"];
    let inside = [Some(skinned.inside), Some(raw.inside), None, None];
    for (t, (tier, inside)) in tiers.iter().zip(inside).enumerate() {
        let gaps = tier.energies.iter().zip(&tiers[3].energies);
        let gap: f64 = gaps
            .map(|(a, b)| a.iter().sum::<f64>() - b.iter().sum::<f64>())
            .sum();
        let mean = |x: usize| format!("{:.2}", x as f64 / n as f64);
        let first = |x: String| if t == 0 { x } else { String::new() };
        table.row([
            first(name.clone()),
            first(subject.name()),
            names[t].to_owned(),
            format!("{:.4}", tier.strain(&set)?),
            format!("{:.4}", gap / n as f64),
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
    let swinging = Model {
        sway: match swings::are_ours(model) {
            true => swings::swings((avatar, &set.figure), (&set.cloth, &set.start))?,
            false => None,
        },
        ..model.clone()
    };
    speed((avatar, &swinging), &set)
}

/// A model's garment and body on a clip, or on its first seconds.
pub(super) fn set<'a>(
    (avatar, model): (&'a Avatar, &Model),
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
    let options = as_trained(model, &options)?;
    let shape = asked_shape(avatar, &options.dress)?;
    let figure = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
    let moving = motion::load((avatar, None), &figure, &options)?;
    let outfit = Outfit::make(avatar, &options.dress, |_| {})?;
    let outfit = outfit.sized((avatar, &shape), &options.dress)?;
    let set = Set::new(avatar, figure, moving, outfit)?;
    fits(model, &set.cloth)?;
    Ok(set)
}

/// Frames a second of the network alone, one frame after the other.
fn speed((avatar, model): (&Avatar, &Model), set: &Set) -> Result<String, Failure> {
    let mut player = Player::new(model, avatar).map_err(|e| model_failure(&e))?;
    let pose = &set.moving.motion.poses[set.moving.lead];
    let bones = avatar.bones(&set.figure, pose);
    let n = player.n_verts();
    let mut out = vec![[0.0f32; 3]; 32 * n];
    let network = least_of(10, || player.frame(pose, &bones, &mut out[..n]));
    let with_bones = least_of(10, || {
        let bones = avatar.bones(&set.figure, pose);
        player.frame(pose, &bones, &mut out[..n]);
    });
    let together = least_of(10, || player.frames(&[(pose, &bones[..]); 32], &mut out));
    Ok(format!(
        "network, codes, shapes and skinning on one core: {:.0} frames a second, 32 together {:.0}; with the posed bones {:.0}",
        1e3 / network.wall,
        32e3 / together.wall,
        1e3 / with_bones.wall
    ))
}

fn crossings(faces: &[[u32; 3]], x: &[DVec3]) -> usize {
    let mesh = Mesh {
        verts: x.to_vec(),
        faces: faces.to_vec(),
    };
    self_intersections(&mesh).len()
}

/// Stretch, bending and weight [J] of cloth at `x` [m], by the laws that solver and trainer share.
fn energies(cloth: &Cloth, x: &[DVec3]) -> [f64; 3] {
    let mut out = [0.0; 3];
    let g = DVec3::new(0.0, -9.81, 0.0);
    for (f, face) in cloth.faces.iter().enumerate() {
        let material = &cloth.materials[cloth.material_of[f] as usize];
        let Some(rest) = RestTriangle::new(cloth.rest[f]) else {
            continue;
        };
        let corners = face.map(|v| x[v as usize]);
        out[0] += membrane::energy(&corners, &rest, &material.stretch);
        let third = material.density * rest.area / 3.0;
        out[2] += corners
            .iter()
            .map(|p| point::gravity(*p, third, g).energy)
            .sum::<f64>();
    }
    for s in hinge::stencils(&cloth.faces) {
        let material = &cloth.materials[cloth.material_of[s.faces[0] as usize] as usize];
        let rest = flat::FlatHinge::new(s.corners(&cloth.rest), &material.bend);
        out[1] += flat::energy(&s.verts.map(|v| x[v as usize]), &rest);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_is_named() {
        let fault = garments(
            None,
            &[],
            (3, &DressOptions::default()),
            &mut Watch::nobody(),
        )
        .expect_err("no data");
        assert_eq!(fault.code, "no-data");
        let fault = garments(
            Some(Path::new(".")),
            &[],
            (3, &DressOptions::default()),
            &mut Watch::nobody(),
        )
        .expect_err("no model");
        assert_eq!((fault.code, fault.exit), ("no-model", Exit::Usage));
    }
}
