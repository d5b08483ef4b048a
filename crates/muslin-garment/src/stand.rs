//! The dress stand: a body in its rest pose as a tailor sees it.

use crate::GarmentError;
use crate::tube::{Axis, Tube};
use glam::DVec3;
use muslin_body::{Avatar, Figure, Part};
use muslin_geom::Surface;

/// The two sides of a body, in the order left (+X), right (−X).
pub(crate) const SIDES: [&str; 2] = ["L", "R"];

/// What is the same on every body: where the limbs are on the tights.
#[derive(Clone, Debug)]
pub(crate) struct BodyMap {
    pub tights: Vec<[u32; 3]>,
    pub skirt: Vec<[u32; 3]>,
    pub collision: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
    /// Where every vertex is on the default body [m].
    pub base: Vec<DVec3>,
    /// Share of each arm's bones in every vertex.
    pub arm: [Vec<f64>; 2],
    /// Bones: shoulder, elbow, wrist, hip, knee, ankle of each side.
    joints: [[usize; 6]; 2],
    /// The lowest vertex of the tights between the legs.
    crotch: u32,
    /// The lowest vertex of the tights between each arm and the trunk.
    armpit: [u32; 2],
    /// The highest vertex of the tights, at the neck.
    neck: u32,
    /// From crotch to armpits on the default body [m].
    trunk: f64,
}

/// Joints of one side [m].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limbs {
    pub shoulder: DVec3,
    pub elbow: DVec3,
    pub wrist: DVec3,
    pub hip: DVec3,
    pub ankle: DVec3,
}

/// One figure on the stand.
pub(crate) struct Stand<'a> {
    pub map: &'a BodyMap,
    pub verts: &'a [DVec3],
    pub skin: Surface,
    pub limbs: [Limbs; 2],
    /// The lowest place of the trunk, between the legs [m].
    pub crotch: DVec3,
    /// Height of the upper end of the tights [m].
    pub neck: f64,
    /// Height of the armpits [m].
    pub armpit: f64,
}

const ARM: [&str; 5] = ["upperarm", "lowerarm", "wrist", "metacarpal", "finger"];
const JOINTS: [&str; 6] = [
    "upperarm01",
    "lowerarm01",
    "wrist",
    "upperleg01",
    "lowerleg01",
    "foot",
];

impl BodyMap {
    /// Reads an avatar; its default figure says where crotch and armpits are.
    pub fn new(avatar: &Avatar, base: &Figure) -> Result<BodyMap, GarmentError> {
        let mut joints = [[0; 6]; 2];
        for (s, side) in SIDES.iter().enumerate() {
            for (j, name) in JOINTS.iter().enumerate() {
                joints[s][j] = avatar.bone(&format!("{name}.{side}"))?;
            }
        }
        let tights = avatar.tights_faces().to_vec();
        let arm = SIDES.map(|s| limb_share(avatar, &ARM, s));
        let range = avatar.part(Part::Tights);
        let lowest = |keep: &dyn Fn(usize) -> bool| -> Result<u32, GarmentError> {
            let all = range.clone().filter(|&i| keep(i));
            let low = all.min_by(|&i, &j| base.verts[i].y.total_cmp(&base.verts[j].y));
            low.map(|i| i as u32).ok_or(GarmentError::NoTights)
        };
        // Not every body is symmetric, and none has a crotch far from its middle.
        let between = |far: &f64| lowest(&|i| base.verts[i].x.abs() < *far).ok();
        let crotch = [0.002, 0.004, 0.008, 0.016].iter().find_map(between);
        let crotch = crotch.ok_or(GarmentError::NoTights)?;
        let pit = |s: usize| lowest(&|i| (0.25..0.75).contains(&arm[s][i]));
        let armpit = [pit(0)?, pit(1)?];
        let y = |i: u32| base.verts[i as usize].y;
        let trunk = (y(armpit[0]) + y(armpit[1])) / 2.0 - y(crotch);
        Ok(BodyMap {
            base: base.verts.clone(),
            edges: edges(&tights),
            collision: avatar.collision_faces().to_vec(),
            tights,
            skirt: avatar.skirt_faces().to_vec(),
            arm,
            joints,
            crotch,
            armpit,
            trunk,
            neck: highest(base, range).ok_or(GarmentError::NoTights)?,
        })
    }
}

impl BodyMap {
    /// The highest vertex of the tights, at the neck.
    pub fn neck_vertex(&self) -> usize {
        self.neck as usize
    }
}

fn highest(base: &Figure, mut range: std::ops::Range<usize>) -> Option<u32> {
    let first = range.next()?;
    let y = |i: usize| base.verts[i].y;
    Some(range.fold(first, |a, b| if y(b) > y(a) { b } else { a }) as u32)
}

/// How much of every vertex hangs on the bones of one limb.
pub(crate) fn limb_share(avatar: &Avatar, names: &[&str], side: &str) -> Vec<f64> {
    let rig = avatar.rig();
    let on_limb: Vec<bool> = (rig.bones.iter())
        .map(|b| b.name.ends_with(side) && names.iter().any(|n| b.name.starts_with(n)))
        .collect();
    let share = |row: &[(u32, f64)]| {
        row.iter()
            .filter(|(b, _)| on_limb[*b as usize])
            .map(|(_, w)| w)
            .sum()
    };
    rig.weights.rows().map(share).collect()
}

fn edges(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let pairs = faces
        .iter()
        .flat_map(|f| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]]);
    let mut all: Vec<[u32; 2]> = pairs.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    all.sort_unstable();
    all.dedup();
    all
}

impl<'a> Stand<'a> {
    pub fn new(map: &'a BodyMap, figure: &'a Figure) -> Stand<'a> {
        let verts = &figure.verts;
        let limbs = map.joints.map(|j| Limbs {
            shoulder: figure.joints[j[0]],
            elbow: figure.joints[j[1]],
            wrist: figure.joints[j[2]],
            hip: figure.joints[j[3]],
            ankle: figure.joints[j[5]],
        });
        let y = |i: u32| verts[i as usize].y;
        Stand {
            skin: Surface::new(verts, &map.collision),
            limbs,
            crotch: verts[map.crotch as usize],
            neck: y(map.neck),
            armpit: (y(map.armpit[0]) + y(map.armpit[1])) / 2.0,
            map,
            verts,
        }
    }

    /// Whether this is the default body.
    pub fn is_standard(&self) -> bool {
        self.verts == self.map.base
    }

    /// The height from crotch to armpit [m]: the scale of the trunk.
    pub fn trunk(&self) -> f64 {
        self.armpit - self.crotch.y
    }

    /// The middle of the waist [m]: a little above half way from crotch to armpits.
    pub fn waist(&self) -> DVec3 {
        self.crotch.with_y(self.crotch.y + 0.6 * self.trunk())
    }

    /// How much longer the trunk is than the default body's.
    pub fn scale(&self) -> f64 {
        self.trunk() / self.map.trunk
    }

    /// Slices of the tights where `keep` holds at both ends of an edge.
    pub fn tube(&self, axis: Axis, range: (f64, f64), keep: impl Fn(usize) -> bool) -> Tube {
        let kept = self
            .map
            .edges
            .iter()
            .filter(|e| e.iter().all(|&i| keep(i as usize)));
        let at = |e: &[u32; 2]| e.map(|i| self.verts[i as usize]);
        Tube::measure(axis, range, &kept.map(at).collect::<Vec<_>>())
    }

    /// The trunk without arms, by height [m].
    pub fn trunk_tube(&self, bottom: f64, top: f64) -> Tube {
        let axis = Axis::new(DVec3::ZERO, DVec3::Y, DVec3::Z);
        let [l, r] = &self.map.arm;
        self.tube(axis, (bottom, top), |i| l[i] + r[i] < 0.5)
    }

    /// Height of the skirt's upper edge [m].
    pub fn skirt_top(&self) -> f64 {
        let all = self.map.skirt.iter().flatten();
        all.map(|&i| self.verts[i as usize].y)
            .fold(f64::MIN, f64::max)
    }
}
