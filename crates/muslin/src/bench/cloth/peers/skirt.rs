//! The moving skirt: one scene as plain files, which every simulator loads.
//!
//! A cone of cloth hangs from a waistline that is held, around hips and closed legs that stand
//! still, then turn and sway. Cloth and body are OBJ, all else is in `scene.json`: SI, Y up.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3};
use muslin_energy::{hinge::Bend, membrane::Stretch};
use muslin_geom::{Mesh, Report, Value};
use muslin_io::{IoError, Node, Scene, obj, report_json};
use muslin_sim::{Cloth, Material};

/// Vertices of the skirt: around, and from waist to hem.
const SKIRT: [usize; 2] = [90, 56];
/// Radius at waist and hem, and length along the slope [m].
const CONE: [f64; 3] = [0.125, 0.31, 0.6];
/// Vertices of the body around; rings of the trunk; rings of each cap.
const BODY: [usize; 3] = [48, 29, 7];
/// Half-axes of the body [m] at the waist, the hips and the feet, and how deep these are [m].
const ELLIPSES: [(f64, DVec2); 3] = [
    (0.0, DVec2::new(0.119, 0.119)),
    (0.15, DVec2::new(0.155, 0.115)),
    (0.7, DVec2::new(0.12, 0.09)),
];
/// Height of the caps above and below [m].
const CAPS: [f64; 2] = [0.12, 0.09];
/// Moves after the start, and how many there are in a second.
pub const FRAMES: usize = 75;
pub const FPS: f64 = 60.0;
/// How long the body stands still first, and how long it takes to be in full swing [s].
const STILL: f64 = 0.2;
const GATHER: f64 = 0.4;
/// Widest turn [rad] and sway [m], and the pace of both [rad/s]: fastest turn 5 rad/s.
const TURN: f64 = PI / 3.0;
const SWAY: f64 = 0.1;
const PACE: f64 = 4.77;
/// Earth's pull [m/s²].
pub const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
/// Stiffness [N/m] and Poisson's ratio of the cloth, were it one sheet.
const SHEET: [f64; 2] = [1000.0, 0.3];
/// Distance at which cloth is to keep from body and cloth [m].
pub const APART: f64 = 3e-3;

/// The scene.
pub struct Skirt {
    /// The cloth as it starts, which is also its rest shape.
    pub cloth: Mesh,
    /// Vertices that go where the body goes: the first row.
    pub pinned: Vec<u32>,
    /// The last row.
    pub hem: Vec<u32>,
    /// The body at rest.
    pub body: Mesh,
    /// Where the body is at the start and after every move.
    pub motion: Vec<(DQuat, DVec3)>,
}

impl Skirt {
    /// The scene, positions to the micrometre as its files have them.
    pub fn new() -> Skirt {
        let [around, along] = SKIRT.map(|n| n as u32);
        Skirt {
            cloth: cone(),
            pinned: (0..around).collect(),
            hem: (around * (along - 1)..around * along).collect(),
            body: hips(),
            motion: (0..=FRAMES).map(|k| place(k as f64 / FPS)).collect(),
        }
    }

    /// `points` as the body has moved them at frame `k`.
    pub fn moved(&self, points: &[DVec3], k: usize) -> Vec<DVec3> {
        self.moved_part(points, (k, 1))
    }

    /// The same after `k` of `parts` of a frame.
    pub fn moved_part(&self, points: &[DVec3], (k, parts): (usize, usize)) -> Vec<DVec3> {
        let share = (k % parts) as f64 / parts as f64;
        let [from, to] = [0, 1].map(|n| self.motion[(k / parts + n).min(FRAMES)]);
        let (turn, way) = (from.0.slerp(to.0, share), from.1.lerp(to.1, share));
        let world = DAffine3::from_rotation_translation(turn, way);
        points.iter().map(|p| world.transform_point3(*p)).collect()
    }

    /// The cloth in our simulator's terms: every face laid flat, its warp along the length.
    pub fn woven(&self) -> Cloth {
        let faces = &self.cloth.faces;
        let corners = |f: &[u32; 3]| laid_along(f.map(|i| self.cloth.verts[i as usize]));
        Cloth {
            rest: faces.iter().map(corners).collect(),
            faces: faces.clone(),
            materials: vec![material()],
            material_of: vec![0; faces.len()],
            layers: vec![0; self.cloth.verts.len()],
            pins: self.pinned.clone(),
        }
    }

    /// Names and contents of the files.
    pub fn files(&self) -> Result<Vec<(&'static str, String)>, IoError> {
        Ok(vec![
            ("scene.json", report_json(&self.told())),
            ("cloth.obj", text("cloth", &self.cloth)?),
            ("body.obj", text("body", &self.body)?),
        ])
    }

    fn told(&self) -> Report {
        let list = |values: &[f64]| Value::List(values.iter().map(|&x| x.into()).collect());
        let places = self.motion.iter().map(|(turn, way)| {
            let numbers = [way.to_array().as_slice(), &turn.to_array()].concat();
            list(&numbers)
        });
        let pinned: Vec<f64> = self.pinned.iter().map(|&i| f64::from(i)).collect();
        let mut r = Report::default();
        r.set("name", "moving skirt")
            .set("frames", FRAMES)
            .set("frames_per_second", FPS)
            .set("gravity", list(&GRAVITY.to_array()))
            .set("cloth", "cloth.obj")
            .set("body", "body.obj")
            .set("material", told_material())
            .set("pinned", list(&pinned))
            .set("motion", places.collect::<Vec<_>>());
        r
    }
}

fn told_material() -> Report {
    let m = material();
    let mut r = Report::default();
    r.set("density_kg_m2", m.density)
        .set("stretch_n_m", SHEET[0])
        .set("poisson", SHEET[1])
        .set("shear_n_m", m.stretch.shear)
        .set("bend_n_m", m.bend.warp)
        .set("friction", m.friction)
        .set("apart_m", APART);
    r
}

/// A shirting that is the same in all directions.
fn material() -> Material {
    let [stretch, poisson] = SHEET;
    Material {
        density: 0.15,
        stretch: Stretch {
            warp: stretch,
            weft: stretch,
            shear: stretch / (2.0 * (1.0 + poisson)),
            compression: 1.0,
        },
        bend: Bend {
            warp: 2.5e-5,
            weft: 2.5e-5,
        },
        limit: Some(0.05),
        friction: 0.4,
        // Cloth keeps two thicknesses from cloth.
        thickness: 0.5 * APART,
    }
}

fn text(name: &str, mesh: &Mesh) -> Result<String, IoError> {
    let node = Node {
        name: name.into(),
        mesh: mesh.clone(),
        ..Node::default()
    };
    obj(&Scene {
        name: name.into(),
        nodes: vec![node],
        ..Scene::default()
    })
}

/// To the micrometre, as files have it.
fn rounded(p: DVec3) -> DVec3 {
    (p * 1e6).round() / 1e6
}

/// `n` points around the vertical axis at `height`, counter-clockwise seen from above.
fn ring(n: usize, axes: DVec2, height: f64) -> impl Iterator<Item = DVec3> {
    let at = move |i: usize| DVec2::from_angle(-TAU * i as f64 / n as f64) * axes;
    (0..n).map(move |i| rounded(DVec3::new(at(i).x, height, at(i).y)))
}

/// Outward triangles between rings of `n` points, given from the top; diagonals alternate.
fn bands(n: usize, rings: usize) -> Vec<[u32; 3]> {
    let mut faces = Vec::new();
    for (r, i) in (1..rings).flat_map(|r| (0..n).map(move |i| (r, i))) {
        let next = (i + 1) % n;
        let [a, b] = [i, next].map(|i| ((r - 1) * n + i) as u32);
        let [c, d] = [i, next].map(|i| (r * n + i) as u32);
        faces.extend(if (r + i) % 2 == 0 {
            [[a, c, d], [a, d, b]]
        } else {
            [[a, c, b], [b, c, d]]
        });
    }
    faces
}

/// The skirt: a cone without its tip, the waist at height zero.
fn cone() -> Mesh {
    let ([around, along], [waist, hem, slope]) = (SKIRT, CONE);
    let drop = (slope * slope - (hem - waist) * (hem - waist)).sqrt();
    let row = |k: usize| {
        let share = k as f64 / (along - 1) as f64;
        let radius = waist + share * (hem - waist);
        ring(around, DVec2::splat(radius), -share * drop)
    };
    Mesh {
        verts: (0..along).flat_map(row).collect(),
        faces: bands(around, along),
    }
}

/// Hips and closed legs: ellipses over one another, with rounded caps.
fn hips() -> Mesh {
    let [around, trunk, cap] = BODY;
    let deepest = ELLIPSES[2].0;
    let angle = |k: usize| FRAC_PI_2 * k as f64 / (cap + 1) as f64;
    let dome = |k: usize| (ELLIPSES[0].1 * angle(k).sin(), CAPS[0] * angle(k).cos());
    let foot = |k: usize| {
        let height = -deepest - CAPS[1] * angle(k).sin();
        (ELLIPSES[2].1 * angle(k).cos(), height)
    };
    let between = |k: usize| {
        let deep = deepest * k as f64 / (trunk - 1) as f64;
        (girth(deep), -deep)
    };
    let rings: Vec<(DVec2, f64)> = (1..=cap)
        .map(dome)
        .chain((0..trunk).map(between))
        .chain((1..=cap).map(foot))
        .collect();
    let round = |&(axes, height): &(DVec2, f64)| ring(around, axes, height);
    let mut verts: Vec<DVec3> = rings.iter().flat_map(round).collect();
    let mut faces = bands(around, rings.len());
    let [top, bottom] = [verts.len(), verts.len() + 1].map(|i| i as u32);
    verts.extend([CAPS[0], -deepest - CAPS[1]].map(|y| rounded(DVec3::Y * y)));
    let last = ((rings.len() - 1) * around) as u32;
    for i in 0..around as u32 {
        let next = (i + 1) % around as u32;
        faces.extend([[top, i, next], [bottom, last + next, last + i]]);
    }
    Mesh { verts, faces }
}

/// Half-axes of the trunk so deep below the waist [m].
fn girth(deep: f64) -> DVec2 {
    let k = usize::from(deep > ELLIPSES[1].0);
    let ((from, a), (to, b)) = (ELLIPSES[k], ELLIPSES[k + 1]);
    a.lerp(b, smooth((deep - from) / (to - from)))
}

/// From 0 to 1 with level ends.
fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Where the body is after `seconds`.
fn place(seconds: f64) -> (DQuat, DVec3) {
    let t = (seconds - STILL).max(0.0);
    let swing = smooth(t / GATHER) * (PACE * t).sin();
    (
        DQuat::from_rotation_y(TURN * swing),
        DVec3::X * SWAY * swing,
    )
}

/// A triangle's corners in its own plane [m], y as near to upwards as can be.
fn laid_along(x: [DVec3; 3]) -> [DVec2; 3] {
    let normal = (x[1] - x[0]).cross(x[2] - x[0]).normalize();
    let up = DVec3::Y.reject_from_normalized(normal).normalize();
    let across = up.cross(normal);
    x.map(|p| DVec2::new((p - x[0]).dot(across), (p - x[0]).dot(up)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use muslin_geom::{Surface, self_intersections};
    use muslin_io::read_obj;

    #[test]
    fn the_files_hold_the_scene() {
        let skirt = Skirt::new();
        let files = skirt.files().expect("a sound scene");
        let read = |k: usize| {
            let (name, text): &(_, String) = &files[k];
            read_obj(name, text.as_bytes()).expect("our own file").mesh
        };
        assert_eq!(read(1), skirt.cloth);
        assert_eq!(read(2), skirt.body);
        assert_eq!(skirt.cloth.verts.len(), 5040);
        assert_eq!(skirt.cloth.faces.len(), 9900);
        assert_eq!(skirt.body.verts.len(), 2066);
        let json = &files[0].1;
        let places = json.split("\"motion\"").nth(1).expect("a motion");
        assert_eq!(places.matches('[').count(), 1 + FRAMES + 1);
        assert!(json.contains("\"frames\": 75"));
    }

    #[test]
    fn the_cone_starts_clear_of_a_closed_body() {
        let skirt = Skirt::new();
        let edges = 3 * skirt.body.faces.len() / 2;
        assert_eq!(skirt.body.verts.len() + skirt.body.faces.len(), edges + 2);
        assert!(self_intersections(&skirt.body).is_empty());
        let skin = Surface::new(&skirt.body.verts, &skirt.body.faces);
        let clear = |p: &DVec3| skin.closest(*p, 1.0).map_or(1.0, |c| c.signed);
        let least = skirt.cloth.verts.iter().map(clear).fold(1.0, f64::min);
        assert!(least > 5e-3, "{least}");
        let normal = skirt.cloth.vertex_normals()[100];
        assert!(normal.dot(skirt.cloth.verts[100].with_y(0.0)) > 0.0);
    }

    #[test]
    fn the_waist_goes_rigidly_with_the_body() {
        let skirt = Skirt::new();
        let waist: Vec<DVec3> = skirt
            .pinned
            .iter()
            .map(|&i| skirt.cloth.verts[i as usize])
            .collect();
        assert!(waist.iter().all(|p| p.y == 0.0));
        for k in 0..=FRAMES {
            let now = skirt.moved(&waist, k);
            let off = (now[0].distance(now[40]) - waist[0].distance(waist[40])).abs();
            assert!(off < 1e-12, "{off}");
        }
        assert_eq!(skirt.moved(&waist, 12), waist);
        let turn = |k: usize| skirt.motion[k].0.angle_between(skirt.motion[k - 1].0) * FPS;
        let fastest = (1..=FRAMES).map(turn).fold(0.0, f64::max);
        assert!((4.8..5.2).contains(&fastest), "{fastest} rad/s");
    }

    #[test]
    fn laid_flat_no_face_changes_its_edges() {
        let skirt = Skirt::new();
        for (face, flat) in skirt.cloth.faces.iter().zip(skirt.woven().rest) {
            let solid = face.map(|i| skirt.cloth.verts[i as usize]);
            for k in 0..3 {
                let [a, b] = [k, (k + 1) % 3];
                assert!((solid[a].distance(solid[b]) - flat[a].distance(flat[b])).abs() < 1e-9);
            }
            assert!((flat[1] - flat[0]).perp_dot(flat[2] - flat[0]) > 0.0);
        }
    }
}
