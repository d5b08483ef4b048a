//! What our solver makes of a clip's cloth on its body: single frames led to rest, or all simulated.

use std::ops::ControlFlow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use muslin_energy::{RestTriangle, membrane, plate, point};
use muslin_garment::Fabric;
use muslin_geom::{Drape, Report};
use muslin_io::Clip;
use muslin_sim::{Cloth, Frame, Options, Settled, SimError, Walk, drape_while, simulate_while};
use rayon::prelude::*;

use super::frame::sound;
use super::material::{Reference, corners};
use super::{Distances, mean};
use crate::drape::{material, to_rest};
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::watch::Watch;

/// Steps that lead from a frame to the minimiser.
pub(crate) const CONVERGED: usize = 120;
/// What cloth is made of where nobody says: the reference cloth, as a fabric.
const REFERENCE: &str = "paper-snug-cotton";

/// The cloth and body of a clip, for the solver.
pub struct Solver<'a> {
    clip: &'a Clip,
    cloth: Cloth,
    fabrics: String,
}

impl<'a> Solver<'a> {
    /// The garments of `clip` in the fabrics that it names, all of them in `fabric` if that is given.
    pub fn new(clip: &'a Clip, fabric: Option<&str>) -> Result<Self, Failure> {
        if clip.body.is_empty() {
            let fault = Failure::new(Exit::Invalid, "no-body", "the file has no body");
            return Err(fault.hint(
                "the solver needs what the cloth lies on: arrays body and body_faces, a mesh called body, or body.pc2",
            ));
        }
        let garments = clip.garments().len();
        let made_of = |k: usize| {
            if let Some(asked) = fabric {
                return Ok(fabric::find(asked)?.0);
            }
            // A name of somebody else's file leads to no other file.
            let found = fabric::named(clip.fabric(k).unwrap_or(REFERENCE));
            found.map_err(|fault| Failure {
                exit: Exit::Invalid,
                place: String::new(),
                ..fault.hint(
                    "it is what the file calls its cloth: name the fabric's own file with --fabric",
                )
            })
        };
        let fabrics: Vec<Fabric> = (0..garments).map(made_of).collect::<Result<_, _>>()?;
        let faces = clip.drape.faces.len();
        let mut cloth = Cloth {
            faces: clip.drape.faces.clone(),
            rest: corners(clip),
            materials: fabrics.iter().map(material).collect(),
            material_of: vec![0; faces],
            layers: vec![0; clip.n_verts()],
            pins: clip.pins.clone(),
        };
        for (k, part) in clip.drape.parts.iter().enumerate() {
            cloth.material_of[part.faces.clone()].fill(k as u32);
            cloth.layers[part.verts.clone()].fill(k as u32);
        }
        let names: Vec<&str> = fabrics.iter().map(|f| f.name.as_str()).collect();
        Ok(Self {
            clip,
            fabrics: names.join(", "),
            cloth,
        })
    }

    /// `n` frames, evenly spread, or all: what they cost above where the solver leads each of them if the body stands
    /// still in it.
    pub fn minimised(
        &self,
        n: Option<usize>,
        (reference, watch): (&Reference, &mut Watch),
    ) -> Result<Report, Failure> {
        let frames = &self.clip.drape.frames;
        let sound = sound(self.clip);
        let frames: Vec<usize> = (0..frames.len()).filter(|&t| sound[t]).collect();
        let n = n.unwrap_or(frames.len()).clamp(1, frames.len());
        let asked: Vec<usize> = (0..n)
            .map(|i| frames[(2 * i + 1) * frames.len() / (2 * n)])
            .collect();
        let (go_on, done) = (watch.may_go_on(), AtomicUsize::new(0));
        let watched = Mutex::new(&mut *watch);
        let solve = |&t: &usize| {
            let settled = self.at_rest(t, &go_on)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            let mut watch = watched.lock().expect("nobody panics while telling");
            watch.progress(&format!("{done} of {n} frames led to rest"));
            Ok((t, settled))
        };
        let solved: Vec<Result<_, SimError>> = asked.par_iter().map(solve).collect();
        watch.go_on()?;
        let mut gaps = [0.0; 3];
        let mut distances = Distances::default();
        let (mut strains, mut pairs, mut crossings) = (Vec::new(), 0, 0);
        for solved in solved {
            let (t, settled) = solved.map_err(|e| failure(&e))?;
            let x = &self.clip.drape.frames[t];
            let [ours, theirs] = [x, &settled.verts].map(|x| energies(&self.cloth, x));
            (0..3).for_each(|i| gaps[i] += (ours[i] - theirs[i]) / n as f64);
            distances.add(x, &settled.verts);
            let faces = &self.cloth.faces;
            strains.push([x, &settled.verts].map(|x| reference.strain(faces, x)));
            pairs += settled.body_intersections;
            crossings += settled.self_crossings;
        }
        let mut r = self.told("minimiser");
        r.set("frames", n)
            .set("energy_gap_J", gaps.iter().sum::<f64>())
            .set("energies_of", self.fabrics.as_str());
        r.set("gap_of_stretch_J", gaps[0])
            .set("gap_of_bending_J", gaps[1])
            .set("gap_of_weight_J", gaps[2]);
        r.set(
            "strain_in_these_frames_J",
            mean(strains.iter().map(|s| s[0])),
        )
        .set(
            "strain_of_the_minimiser_J",
            mean(strains.iter().map(|s| s[1])),
        );
        distances.tell(&mut r);
        r.set("body_intersections_left", pairs)
            .set("self_crossings_left", crossings);
        Ok(r)
    }

    /// Frame `t` led to rest.
    pub fn at_rest(
        &self,
        t: usize,
        go_on: &(dyn Fn() -> bool + Sync),
    ) -> Result<Settled, SimError> {
        let body = [Frame::from(self.clip.body[t].clone())];
        let start = &self.clip.drape.frames[t];
        let body = (&body[..], &self.clip.body_faces[..]);
        drape_while(&self.cloth, start, body, (&to_rest(CONVERGED), go_on))
    }

    /// The same cloth on the same body simulated: it comes to rest where the first frame lies, sets off with the body, and
    /// goes its own way from there.
    pub fn simulated(&self, watch: &mut Watch) -> Result<Clip, Failure> {
        let clip = self.clip;
        let frames = clip.drape.frames.len();
        if frames < 2 {
            let fault = Failure::new(Exit::Invalid, "one-frame", "the file has one frame only");
            return Err(fault.hint("one frame does not move: hold it against the minimiser"));
        }
        if let Some(t) = sound(clip).iter().position(|s| !s) {
            let what = format!("frame {t} has positions that are no numbers");
            let fault = Failure::new(Exit::Invalid, "not-finite", what);
            return Err(fault.hint("the simulator needs the whole motion of the body, and the first frame of the cloth"));
        }
        let at = |t: usize| Frame::from(clip.body[t].clone());
        let walk = Walk {
            faces: &clip.body_faces,
            rest: &clip.body[0],
            frames,
            lead: 0,
            fps: clip.drape.fps,
            at: &at,
        };
        let start = &clip.drape.frames[0];
        let go_on = watch.may_go_on();
        let mut cloth = Vec::with_capacity(frames);
        let mut body = Vec::with_capacity(frames);
        let ended = simulate_while(
            &self.cloth,
            (start, None),
            (&walk, &Options::default(), &go_on),
            |m| {
                cloth.push(m.verts.to_vec());
                body.push(m.body.to_vec());
                watch.progress(&format!("frame {} of {frames} simulated", cloth.len()));
                ControlFlow::Continue(())
            },
        );
        watch.go_on()?;
        ended.map_err(|e| failure(&e))?;
        Ok(Clip {
            drape: Drape {
                frames: cloth,
                ..clip.drape.clone()
            },
            body,
            ..clip.clone()
        })
    }

    /// The beginning of what is told of it: who the clip is held against, and in what fabric.
    pub fn told(&self, by: &str) -> Report {
        let mut r = Report::default();
        r.set("by", by).set("fabric", self.fabrics.as_str());
        r
    }
}

fn failure(error: &SimError) -> Failure {
    let exit = match error {
        SimError::NoRestShape(_) => Exit::Invalid,
        _ => Exit::Numbers,
    };
    Failure::new(exit, "solver", error.to_string())
}

/// Stretch, bending and weight [J] of cloth at `x` [m], by the laws that solver and trainer share.
pub(crate) fn energies(cloth: &Cloth, x: &[DVec3]) -> [f64; 3] {
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
    let bend = |f: usize| cloth.materials[cloth.material_of[f] as usize].bend;
    for (verts, rest) in plate::plates(&cloth.faces, &cloth.rest, bend) {
        out[1] += plate::energy(&verts.map(|v| x[v as usize]), &rest);
    }
    out
}
