//! A trained garment on recordings it never learnt from: the network, refined, and the minimiser.

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
use super::needed;
use crate::animate::{as_trained, fits, model_failure, predict, read_model, refined};
use crate::dress::asked_shape;
use crate::evaluate::evaluate;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::outfit::Outfit;
use crate::simulate::SimulateOptions;
use crate::simulate::motion;
use crate::simulate::reel::{Reel, Told};
use crate::simulate::set::Set;
use crate::table::Table;

/// Recordings that nothing which ships may learn from.
pub const HELD_OUT: [&str; 3] = [
    "motion/cmu-bvh/02_01_walk.bvh",
    "motion/cmu-bvh/05_06_dance-modern.bvh",
    "motion/cmu-bvh/01_01_playground_forward-jumps_turn.bvh",
];
/// Solver iterations of the refined tier.
const REFINE: usize = 5;
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

/// The figures of the model at `model` on recordings of the data folder, `cases` frames in all.
pub fn garments(
    data: Option<&Path>,
    model: Option<&Path>,
    cases: usize,
) -> Result<String, Failure> {
    let data = needed(data)?;
    let path = model.map(PathBuf::from).ok_or_else(|| {
        let fault = Failure::new(Exit::Usage, "no-model", "no model to measure");
        fault.hint("name one with --model; `muslin train` makes it")
    })?;
    let model = read_model(&path)?;
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let mut table = Table::new(&[
        "clip",
        "tier",
        "strain J",
        "gap J",
        "inside %",
        "body pairs",
        "crossings",
        "frames",
    ]);
    let mut rate = String::new();
    for clip in HELD_OUT {
        rate = one_clip(
            (&avatar, &model),
            &data.join(clip),
            cases.div_ceil(HELD_OUT.len()),
            &mut table,
        )?;
    }
    let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
    let note = |n: &str| {
        model
            .notes
            .get(n)
            .map_or("unknown", String::as_str)
            .to_owned()
    };
    Ok(format!(
        "{}\n\n{}: {} in {}, {} vertices, {:.2} MB, {} codes, trained on {}\n{rate}; {}\n\
         strain: StVK of the reference cloth; gap: stretch, bending and weight in the garment's own \
         fabric above\nthe solver after {CONVERGED} more iterations; crossings and pairs are a frame's mean, by exact predicates",
        table.text(),
        path.display(),
        note("garment"),
        note("fabric"),
        model.n_verts(),
        bytes as f64 / 1e6,
        model.n_codes(),
        match note("trained_on").split("; ").count() {
            1 => "one motion".to_owned(),
            n => format!("{n} motions"),
        },
        load(),
    ))
}

fn one_clip(
    (avatar, model): (&Avatar, &Model),
    clip: &Path,
    n: usize,
    table: &mut Table,
) -> Result<String, Failure> {
    let set = set((avatar, model), clip)?;
    let raw = predict(&set, model)?;
    let plain = Model {
        modes: vec![0.0; model.modes.len()],
        ..model.clone()
    };
    let skinned = predict(&set, &plain)?;
    let all = raw.frames.len();
    let mut tiers: [Tier; 4] = Default::default();
    let frames: Vec<usize> = (0..n).map(|i| (2 * i + 1) * all / (2 * n)).collect();
    let solve = |k: &usize| {
        let body = set.frame(set.moving.lead + k);
        let near = refined(&set, &raw.frames[*k], (&body, REFINE))?;
        let rest = refined(&set, &near.verts, (&body, CONVERGED))?;
        Ok((*k, body, near, rest))
    };
    let solved: Result<Vec<_>, Failure> = frames.par_iter().map(solve).collect();
    for (k, body, near, rest) in solved? {
        tiers[0].add(&set.cloth, (&skinned.frames[k], &body.skin));
        tiers[1].add(&set.cloth, (&raw.frames[k], &body.skin));
        tiers[2].settled(&set.cloth, &near);
        tiers[3].settled(&set.cloth, &rest);
    }
    let name = muslin_io::name(Path::new(clip.file_stem().unwrap_or_default()));
    let names = ["skinned", "network", "refined", "minimiser"];
    let inside = [Some(skinned.inside), Some(raw.inside), None, None];
    for (t, (tier, inside)) in tiers.iter().zip(inside).enumerate() {
        let gaps = tier.energies.iter().zip(&tiers[3].energies);
        let gap: f64 = gaps
            .map(|(a, b)| a.iter().sum::<f64>() - b.iter().sum::<f64>())
            .sum();
        let mean = |x: usize| format!("{:.2}", x as f64 / n as f64);
        table.row([
            if t == 0 { name.clone() } else { String::new() },
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
    speed((avatar, model), &set)
}

fn set<'a>((avatar, model): (&'a Avatar, &Model), clip: &Path) -> Result<Set<'a>, Failure> {
    let options = SimulateOptions {
        motion: clip.to_string_lossy().into_owned(),
        fps: LOOKS,
        ..SimulateOptions::default()
    };
    let options = as_trained(model, &options)?;
    let shape = asked_shape(avatar, &options.dress)?;
    let figure = avatar.figure(&shape).map_err(|e| body_failure(&e))?;
    let moving = motion::load(avatar, &figure, &options)?;
    let outfit = Outfit::make(avatar, &options.dress, |_| {})?;
    let set = Set::new(avatar, figure, moving, outfit)?;
    fits(model, &set)?;
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
        let fault = garments(None, None, 3).expect_err("no data");
        assert_eq!(fault.code, "no-data");
        let fault = garments(Some(Path::new(".")), None, 3).expect_err("no model");
        assert_eq!((fault.code, fault.exit), ("no-model", Exit::Usage));
    }
}
