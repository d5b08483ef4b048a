//! A coarse shirt on the default body and a small sheet, for tests.

use glam::{DVec2, DVec3};
use muslin_body::{Avatar, Figure, Motion, Pose, Shape, Sparse, motions};
use muslin_energy::{hinge::Bend, membrane::Stretch};
use muslin_garment::{Garment, Recipe, Tee};
use muslin_net::learn::Noise;
use muslin_sim::{Cloth, Material};

use crate::lanes::{LANES, Lane, Row, points};
use crate::{Lesson, Plan, Trainer, Training, diffused};

/// Both trainings go on to that step, a broken one and one that was not, to the same bits.
pub fn go_on_alike<T: Training>(mut both: [&mut T; 2], steps: u64) {
    for t in &mut both {
        while t.steps() < steps {
            t.step().expect("finite");
        }
    }
    let [a, b] = both.map(|t| t.keep().expect("on cores"));
    assert!(a == b, "the bits of an unbroken run");
}

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

    /// The shirt, and the same again a little outside of it.
    pub fn outfit() -> Self {
        let mut class = Self::new();
        let n = class.template.len() as u32;
        let normals = muslin_geom::vertex_normals(&class.template, &class.cloth.faces);
        let pairs = class.template.iter().zip(&normals);
        let outer: Vec<DVec3> = pairs.map(|(p, n)| *p + *n * 0.002).collect();
        class.template.extend(outer);
        let cloth = &mut class.cloth;
        let again: Vec<[u32; 3]> = cloth.faces.iter().map(|f| f.map(|v| v + n)).collect();
        cloth.faces.extend(again);
        cloth.rest.extend_from_within(..);
        cloth.material_of.extend_from_within(..);
        cloth.layers.extend(vec![1; n as usize]);
        for v in 0..n as usize {
            let row = class.weights.row(v).to_vec();
            class.weights.push(row);
        }
        class
    }

    /// Its poses as the motion that they are.
    pub fn wave(&self) -> Motion {
        Motion {
            fps: 25.0,
            poses: self.poses.clone(),
        }
    }

    /// Its shirt in its fabric.
    pub fn lesson(&self) -> Lesson<'_> {
        Lesson {
            avatar: &self.avatar,
            figure: &self.figure,
            cloth: &self.cloth,
            template: &self.template,
            weights: &self.weights,
            traits: &[],
        }
    }

    pub fn trainer(&self) -> Trainer<'_> {
        self.taught(vec![self.lesson()])
    }

    pub fn taught<'a>(&'a self, lessons: Vec<Lesson<'a>>) -> Trainer<'a> {
        let plan = Plan {
            codes: 8,
            hidden: vec![16],
            steps: 40,
            ..Plan::default()
        };
        Trainer::new(lessons, plan, self.poses.clone()).expect("enough poses")
    }
}

/// The shirt on a heavier body, in another fabric, beside the usual one.
pub struct Other {
    pub figure: Figure,
    pub cloth: Cloth,
    pub template: Vec<DVec3>,
}

pub const USUAL: [(&str, f64); 2] = [("ln_bend", -11.5), ("chest", 0.9)];
pub const HEAVY: [(&str, f64); 2] = [("ln_bend", -9.2), ("chest", 1.1)];

impl Other {
    pub fn new(class: &Class) -> Self {
        let shape = Shape::default().with("weight", 0.8).expect("a share");
        let figure = class.avatar.figure(&shape).expect("a body");
        let recipe = Recipe::Tee(Tee {
            edge: 0.025,
            ..Tee::default()
        });
        let garment = Garment::make(&class.avatar, &recipe).expect("a shirt");
        let worn = garment
            .worn(&class.avatar, &figure, &[])
            .expect("it can be worn");
        let mut cloth = class.cloth.clone();
        cloth.rest = worn.rest;
        cloth.materials[0].bend.warp *= 10.0;
        cloth.materials[0].bend.weft *= 10.0;
        // Stiffer than is taught.
        cloth.materials[0].stretch.warp = 1e5;
        Self {
            figure,
            cloth,
            template: worn.verts,
        }
    }

    pub fn lessons<'a>(&'a self, class: &'a Class) -> Vec<Lesson<'a>> {
        let usual = Lesson {
            traits: &USUAL,
            ..class.lesson()
        };
        let heavy = Lesson {
            figure: &self.figure,
            cloth: &self.cloth,
            template: &self.template,
            traits: &HEAVY,
            ..usual
        };
        vec![usual, heavy]
    }
}

/// A sheet of 4 × 3 vertices, unevenly cut.
pub fn sheet() -> Cloth {
    let at = |i: u32| {
        DVec2::new(
            f64::from(i % 4) * 0.012,
            f64::from(i / 4) * 0.011 + 0.001 * f64::from(i % 3),
        )
    };
    let mut faces = Vec::new();
    for c in [0, 1, 2, 4, 5, 6u32] {
        faces.extend([[c, c + 1, c + 5], [c, c + 5, c + 4]]);
    }
    Cloth {
        rest: faces.iter().map(|f: &[u32; 3]| f.map(at)).collect(),
        materials: vec![Material {
            density: 0.2,
            stretch: Stretch {
                warp: 300.0,
                weft: 200.0,
                shear: 50.0,
                compression: 0.2,
            },
            bend: Bend {
                warp: 1e-5,
                weft: 2e-5,
            },
            limit: None,
            friction: 0.3,
            thickness: 5e-4,
        }],
        material_of: vec![0; faces.len()],
        layers: vec![0; 12],
        pins: Vec::new(),
        faces,
    }
}

/// Sixteen crumpled states, metres from the origin.
pub fn states() -> Vec<Row> {
    let mut noise = Noise::new(3);
    let mut x = vec![[0.0; LANES]; 36];
    for v in 0..12 {
        for axis in 0..3 {
            for pose in 0..LANES {
                let flat = [(v % 4) as f64 * 0.012, 0.0, (v / 4) as f64 * 0.011][axis];
                x[3 * v + axis][pose] = (flat + 0.003 * noise.normal() + pose as f64 * 0.05) as f32;
            }
        }
    }
    x
}

pub fn agree(what: &str, got: &[Row], want: &[Vec<DVec3>], energy: (Lane, &[f64])) {
    for pose in 0..LANES {
        let got = points(got, pose);
        let size = want[pose].iter().map(|g| g.length()).fold(1e-12, f64::max);
        for (a, b) in got.iter().zip(&want[pose]) {
            assert!(a.distance(*b) < 2e-4 * size, "{what}: {a} against {b}");
        }
        let (e, w) = (f64::from(energy.0.0[pose]), energy.1[pose]);
        assert!(
            (e - w).abs() < 2e-4 * w.abs(),
            "{what}: energy {e} against {w}"
        );
    }
}
