//! A coarse shirt on the default body, for tests.

use glam::DVec3;
use muslin_body::{Avatar, Figure, Pose, Shape, Sparse, motions};
use muslin_energy::{hinge::Bend, membrane::Stretch};
use muslin_garment::{Garment, Recipe, Tee};
use muslin_sim::{Cloth, Material};

use crate::{Lesson, Plan, Trainer, diffused};

/// Everything a lesson borrows.
pub struct Class {
    pub avatar: Avatar,
    pub figure: Figure,
    pub cloth: Cloth,
    pub template: Vec<DVec3>,
    pub weights: Sparse,
    pub poses: Vec<Pose>,
}

impl Class {
    pub fn new() -> Self {
        let avatar = Avatar::embedded().expect("the embedded body is sound");
        let figure = avatar.figure(&Shape::default()).expect("the default shape");
        let recipe = Recipe::Tee(Tee {
            edge: 0.025,
            ..Tee::default()
        });
        let garment = Garment::make(&avatar, &recipe).expect("a shirt");
        let worn = garment.worn(&avatar, &figure, &[]).expect("it can be worn");
        let skin = garment.skin_weights(&avatar);
        let material = Material {
            density: 0.2,
            stretch: Stretch {
                warp: 33.0,
                weft: 33.0,
                shear: 11.0,
                compression: 0.2,
            },
            bend: Bend {
                warp: 1e-5,
                weft: 1e-5,
            },
            limit: None,
            friction: 0.3,
            thickness: 5e-4,
        };
        let wave = motions::make(&avatar, &figure, "wave", 25.0).expect("a built-in motion");
        Self {
            weights: diffused(&skin, &garment.faces, (10, 6)),
            cloth: Cloth {
                rest: worn.rest,
                materials: vec![material],
                material_of: vec![0; garment.faces.len()],
                layers: vec![0; worn.verts.len()],
                pins: vec![3, 7],
                faces: garment.faces,
            },
            template: worn.verts,
            poses: wave.poses,
            avatar,
            figure,
        }
    }

    pub fn trainer(&self) -> Trainer<'_> {
        let lesson = Lesson {
            avatar: &self.avatar,
            figure: &self.figure,
            cloth: &self.cloth,
            template: &self.template,
            weights: &self.weights,
        };
        let plan = Plan {
            codes: 8,
            hidden: vec![16],
            steps: 40,
            ..Plan::default()
        };
        Trainer::new(lesson, plan, self.poses.clone()).expect("enough poses")
    }
}
