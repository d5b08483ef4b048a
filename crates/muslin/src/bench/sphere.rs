//! One network in several fabrics: a disc of cloth over a ball, predicted, refined and simulated.
//!
//! No garment and no person: a ball of one bone, a disc held in its middle on top, and a network that is taught it in
//! any fabric. What is measured is the drape coefficient: how much of the ring around the ball the cloth shades.

use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec2, DVec3};
use muslin_body::{Avatar, AvatarParts, Bone, Figure, Part, PartCounts, Pose, Rig, Shape, Sparse};
use muslin_garment::Fabric;
use muslin_model::{Model, Player};
use muslin_net::learn::Noise;
use muslin_sim::Cloth;
use muslin_train::{Lesson, Plan, Trainer, Training};

use super::cloth::{DRAPED, coefficient, scenes};
use super::fabrics::FABRICS;
use super::garments::REFINE;
use crate::animate::model_failure;
use crate::drape::material;
use crate::failure::Failure;
use crate::figure::body_failure;
use crate::table::Table;
use crate::train::{failure, variety};
use crate::traits::{self, Trait};
use crate::watch::Watch;

/// What this part of the figures is called.
pub(super) const NAME: &str = "any fabric, sphere";
/// Radius of the ball [m].
const BALL: f64 = 0.05;
/// Radius of the disc, and of what is held of it on top of the ball [m].
const DISC: f64 = 0.09;
const HELD: f64 = 0.012;
/// Edges of the disc [m].
const EDGE: f64 = 9e-3;
/// How far from the ball it is laid at first [m].
const OFF: f64 = 4e-3;
/// How uneven it is laid [m], and in what waves [rad/m]: folds have to begin somewhere.
const UNEVEN: f64 = 2e-3;
const BREATH: DVec2 = DVec2::new(40.0, 17.0);
/// Quads along each side of the six that the ball is made of.
const SIDE: u32 = 16;
/// Fabrics that are learnt from, poses of each, and how far the ball is tilted in them [rad].
const LESSONS: usize = 32;
const POSES: usize = 16;
const TILT: f64 = 0.1;
/// Which of the fabrics the disc is led to rest in before it is taught: wool.
const FIRST: usize = 2;

/// Heads of the table that [`rows`] fills.
pub(super) const HEADS: [&str; 4] = [
    "disc on a sphere",
    "drape %, network",
    "refined",
    "simulated",
];

/// How it is taught. Cloth hardly stretches under its own weight here, whatever it is: taught softer in its plane than a
/// garment, it is sooner draped.
fn plan() -> Plan {
    Plan {
        steps: 3000,
        codes: 32,
        damping: 3e-3,
        stiffest: 50.0,
        firm: 50.0,
        fair: 1.0,
        ..Plan::default()
    }
}

/// The ball as a body at rest.
struct Ball {
    avatar: Avatar,
    figure: Figure,
}

impl Ball {
    /// One bone, and a skin of quads: a cube blown up.
    fn new() -> Result<Self, Failure> {
        let (mut points, mut quads) = (Vec::new(), Vec::new());
        for out in [DVec3::X, DVec3::Y, DVec3::Z]
            .into_iter()
            .flat_map(|a| [a, -a])
        {
            let u = DVec3::new(out.y, out.z, out.x);
            let v = out.cross(u);
            let mut at = |[i, j]: [u32; 2]| {
                let along = |k: u32| ((f64::from(k) / f64::from(SIDE) - 0.5) * FRAC_PI_2).tan();
                let p: DVec3 = (out + u * along(i) + v * along(j)).normalize() * BALL;
                let known = points.iter().position(|q: &DVec3| q.distance(p) < 1e-9);
                known.unwrap_or_else(|| {
                    points.push(p);
                    points.len() - 1
                }) as u32
            };
            for (i, j) in (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j))) {
                quads.push([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(&mut at));
            }
        }
        let body = points.len();
        points.extend([DVec3::ZERO, DVec3::Y * (0.1 * BALL)]);
        let avatar = Avatar::new(AvatarParts {
            counts: PartCounts {
                body,
                ..PartCounts::default()
            },
            mean: points,
            quad_uvs: vec![[0; 4]; quads.len()],
            uvs: vec![[0.0; 2]],
            quads,
            rig: Rig {
                bones: vec![Bone {
                    name: "ball".into(),
                    parent: None,
                    head: 0,
                    tail: 1,
                }],
                weights: rigid(body),
            },
            ..AvatarParts::default()
        });
        let avatar = avatar.map_err(|e| body_failure(&e))?;
        let figure = avatar.figure(&Shape::default());
        Ok(Self {
            figure: figure.map_err(|e| body_failure(&e))?,
            avatar,
        })
    }

    fn still(&self) -> scenes::Still {
        scenes::Still {
            verts: self.figure.verts[self.avatar.part(Part::Body)].to_vec(),
            faces: self.avatar.collision_faces().to_vec(),
        }
    }

    /// What one network learns of the disc in any fabric, from where it lies at first.
    fn taught(&self, laid: &[DVec3], watch: &mut Watch) -> Result<Model, Failure> {
        let (noise, known) = (&mut Noise::new(1), variety::fabrics());
        let named = FABRICS.map(|f| Fabric::named(f).expect("a preset"));
        let between = (FABRICS.len()..LESSONS).map(|_| variety::any_fabric(&known, noise));
        let fabrics: Vec<Fabric> = named.into_iter().chain(between).collect();
        let cloths: Vec<Cloth> = fabrics.iter().map(cut).collect();
        let told: Vec<[Trait; 4]> = fabrics.iter().map(traits::of_fabric).collect();
        let weights = rigid(laid.len());
        let lesson = |k: usize| Lesson {
            avatar: &self.avatar,
            figure: &self.figure,
            cloth: &cloths[k],
            template: laid,
            weights: &weights,
            traits: &told[k],
        };
        let tilted = |_| {
            let mut pose = Pose::rest(&self.avatar);
            let [x, z] = [(); 2].map(|()| TILT * noise.normal());
            pose.rotations[0] = DQuat::from_scaled_axis(DVec3::new(x, 0.0, z));
            pose
        };
        let poses = (0..LESSONS * POSES).map(tilted).collect();
        let plan = plan();
        let steps = plan.steps;
        let trainer = Trainer::new((0..LESSONS).map(lesson).collect(), plan, poses);
        let mut trainer = trainer.map_err(|e| failure(&e))?;
        while trainer.steps() < steps {
            watch.go_on()?;
            let told = trainer.step().map_err(|e| failure(&e))?;
            let (step, e) = (told.step, told.energies.total());
            watch.progress(&format!("{NAME}: step {step} of {steps}, {e:.4} J a pose"));
        }
        trainer.model(BTreeMap::new()).map_err(|e| failure(&e))
    }

    /// Where a model says that the disc lies [m].
    fn predicted(&self, model: &Model) -> Result<Vec<DVec3>, Failure> {
        let mut player = Player::new(model, &self.avatar).map_err(|e| model_failure(&e))?;
        let pose = Pose::rest(&self.avatar);
        let bones = self.avatar.bones(&self.figure, &pose);
        let mut out = vec![[0.0; 3]; player.n_verts()];
        player.frame(&pose, &bones, &mut out);
        let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        Ok(out.iter().map(wide).collect())
    }
}

/// Weights of `n` vertices that follow the one bone.
fn rigid(n: usize) -> Sparse {
    let mut weights = Sparse::new();
    (0..n).for_each(|_| weights.push([(0, 1.0)]));
    weights
}

fn disc() -> scenes::Piece {
    scenes::disc(&scenes::rings(HELD, DISC, EDGE))
}

/// The disc in a fabric.
fn cut(fabric: &Fabric) -> Cloth {
    let piece = disc();
    piece.cloth(material(fabric), |i| piece.points[i].length() < HELD)
}

/// Where the disc is laid over the ball [m]: around its upper half, and straight down from there.
fn laid() -> Vec<DVec3> {
    let around = BALL + OFF;
    let lay = |p: &DVec2| {
        let (r, to) = (p.length(), p.normalize_or_zero());
        let arc = (r / around).min(FRAC_PI_2);
        let below = (r - FRAC_PI_2 * around).max(0.0);
        let out = arc.sin() * (around + 0.5 * UNEVEN * (1.0 + BREATH.dot(*p).sin()));
        DVec3::new(to.x * out, arc.cos() * around - below, -to.y * out)
    };
    disc().points.iter().map(lay).collect()
}

/// Share of the ring around the ball that the cloth shades [%].
fn shaded(cloth: &Cloth, x: &[DVec3]) -> f64 {
    coefficient((x, &cloth.faces), (BALL, DISC))
}

/// Adds a row for each fabric, and says how many.
pub(super) fn rows(table: &mut Table, watch: &mut Watch) -> Result<String, Failure> {
    let ball = Ball::new()?;
    let (still, start) = (ball.still(), laid());
    let fabrics = FABRICS.map(|name| Fabric::named(name).expect("a preset"));
    let cloths = fabrics.each_ref().map(cut);
    let simulated = (cloths.each_ref()).map(|c| scenes::at_rest(c, &start, &still, DRAPED));
    let model = ball.taught(&simulated[FIRST], watch)?;
    for (k, fabric) in fabrics.iter().enumerate() {
        let told = traits::told_all(model.clone(), &traits::of_fabric(fabric));
        let raw = ball.predicted(&told)?;
        let refined = scenes::led(&cloths[k], &raw, &still, REFINE);
        let all = [&raw, &refined, &simulated[k]];
        let [raw, refined, simulated] = all.map(|x| format!("{:.1}", shaded(&cloths[k], x)));
        table.row([fabric.name.clone(), raw, refined, simulated]);
    }
    Ok(format!("{} fabrics on a ball", FABRICS.len()))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn a_ball_is_round_closed_and_faces_outward() {
        let ball = Ball::new().expect("a sound body").still();
        assert!(ball.verts.iter().all(|p| (p.length() - BALL).abs() < 1e-9));
        assert_eq!(
            ball.verts.len() as u32,
            6 * SIDE * SIDE + 2,
            "no doubled point"
        );
        let of = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| ball.verts[v as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        let volume: f64 = ball.faces.iter().map(of).sum();
        let whole = 4.0 / 3.0 * PI * BALL.powi(3);
        assert!((volume / whole - 1.0).abs() < 0.02, "{volume} of {whole}");
    }

    #[test]
    fn a_flat_disc_shades_the_whole_ring_and_one_within_the_ball_nothing() {
        let cloth = cut(&Fabric::named("denim").expect("a preset"));
        let at = |share: f64| -> Vec<DVec3> {
            let flat = |p: &DVec2| DVec3::new(share * p.x, 0.2, -share * p.y);
            disc().points.iter().map(flat).collect()
        };
        let [whole, none] = [1.0, BALL / DISC].map(|s| shaded(&cloth, &at(s)));
        assert!(
            (whole - 100.0).abs() < 1.5 && none.abs() < 1.5,
            "{whole} and {none}"
        );
    }

    #[test]
    fn supple_cloth_hangs_closer_to_a_ball_than_stiff_cloth() {
        let still = Ball::new().expect("a sound body").still();
        let [silk, denim] = ["silk-charmeuse", "denim"].map(|name| {
            let cloth = cut(&Fabric::named(name).expect("a preset"));
            let x = scenes::at_rest(&cloth, &laid(), &still, DRAPED);
            shaded(&cloth, &x)
        });
        assert!(silk + 20.0 < denim && denim < 100.0, "{silk} and {denim}");
    }
}
