//! The body as the solver sees it: a few joints and a few dozen markers.
//!
//! A marker is a weighted mean of skinned vertices. Weights, skin weights and shape modes are
//! all linear, so they fold into one vector for each pair of marker and joint:
//!
//! `x_k = Σ_b R_b (A_kb − c_kb h_b) + c_kb p_b`, `A_kb = Σ_v r_kv w_vb v`, `c_kb = Σ_v r_kv w_vb`
//!
//! with the joint's rotation `R_b`, its head `h_b` at rest and `p_b` now. Exact, and it never
//! touches the mesh: bones that the solver holds still move with the joint they hang from.

use crate::FitError;
use glam::DVec3;
use muslin_body::{Avatar, Blend, REGRESSED};
use std::collections::BTreeMap;

/// The bones that the solver turns, each with the joint group whose rotation it has.
///
/// Bones of one group share one rotation, so a trunk bends evenly.
const BONES: [(&str, &str); 10] = [
    ("root", "root"),
    ("spine05", "waist"),
    ("spine04", "waist"),
    ("spine03", "chest"),
    ("spine02", "chest"),
    ("spine01", "chest"),
    ("neck01", "neck"),
    ("neck02", "neck"),
    ("neck03", "neck"),
    ("head", "head"),
];

/// The same for the bones that have a left and a right.
const PAIRED: [(&str, &str); 8] = [
    ("clavicle", "collar"),
    ("shoulder01", "collar"),
    ("upperarm01", "shoulder"),
    ("lowerarm01", "elbow"),
    ("wrist", "wrist"),
    ("upperleg01", "hip"),
    ("lowerleg01", "knee"),
    ("foot", "ankle"),
];

/// Markers at the heads of bones: knuckles of thumb, index and little finger.
pub const KNUCKLES: [&str; 6] = [
    "finger5-1.L",
    "finger5-1.R",
    "finger2-1.L",
    "finger2-1.R",
    "finger1-2.L",
    "finger1-2.R",
];

/// How many markers there are: the regressed points, then the knuckles.
pub const N_MARKERS: usize = REGRESSED.len() + KNUCKLES.len();

/// How high the trunk's bars are, as a share of the way from hips to shoulders: belly, waist, bust.
pub const RIBS: [f64; 3] = [0.15, 0.5, 0.8];

/// A bone that the solver turns.
#[derive(Debug, Clone)]
pub struct Joint {
    /// Index in the avatar's rig.
    pub bone: usize,
    /// Joint that this one hangs from.
    pub parent: Option<usize>,
    /// Whose rotation it has.
    pub group: usize,
}

/// The share of one marker that one joint carries.
#[derive(Debug, Clone, Copy)]
pub struct Share {
    /// Which joint.
    pub joint: usize,
    /// `c_kb`.
    pub weight: f64,
}

/// Folded body: topology, and where its features are for any shape.
///
/// A feature is a point or weighted sum of points of the rest pose. First the heads of the
/// joints, then one sum `A_kb` for each share, then front and back of each of the trunk's bars,
/// then crown and sole.
#[derive(Debug, Clone)]
pub struct Folded {
    /// Parents come before children.
    pub joints: Vec<Joint>,
    /// Names of the joint groups; the first is `root`.
    pub groups: Vec<String>,
    /// Shares of all markers, one marker after the other.
    pub shares: Vec<Share>,
    /// Where the shares of each marker begin; one more than there are markers.
    pub starts: Vec<usize>,
    blend: Blend,
    mean: Vec<DVec3>,
    modes: Vec<DVec3>,
    points: Vec<Vec<(u32, f64)>>,
}

impl Folded {
    /// Folds the avatar. Some milliseconds; keep it.
    pub fn new(avatar: &Avatar) -> Result<Folded, FitError> {
        let (joints, groups) = joints(avatar)?;
        let owner = owners(avatar, &joints);
        let mut points: Vec<Vec<(u32, f64)>> = joints
            .iter()
            .map(|j| vec![(avatar.head_point(j.bone) as u32, 1.0)])
            .collect();
        let (mut shares, mut starts) = (Vec::new(), vec![0]);
        let ribs = ribs(avatar, &joints, &owner);
        for marker in markers(avatar, &owner, &ribs)? {
            for (joint, sum) in marker {
                shares.push(Share {
                    joint,
                    weight: sum.iter().map(|s| s.1).sum(),
                });
                points.push(sum);
            }
            starts.push(shares.len());
        }
        points.extend(ribs.iter().flat_map(|r| r[0]).map(|p| vec![(p, 1.0)]));
        points.extend(crown_and_sole(avatar).map(|p| vec![(p, 1.0)]));
        let sum = |f: &[(u32, f64)], at: &dyn Fn(usize) -> DVec3| {
            f.iter().map(|&(p, w)| at(p as usize) * w).sum::<DVec3>()
        };
        let mean = points
            .iter()
            .map(|f| sum(f, &|p| avatar.mean()[p]))
            .collect();
        let mut modes = Vec::with_capacity(avatar.n_modes() * points.len());
        for m in 0..avatar.n_modes() {
            let mode = avatar.mode(m);
            modes.extend(points.iter().map(|f| sum(f, &|p| lift(mode[p]))));
        }
        let blend = avatar.blend().clone();
        Ok(Folded {
            joints,
            groups,
            shares,
            starts,
            blend,
            mean,
            modes,
            points,
        })
    }

    /// How many features there are.
    pub fn n_features(&self) -> usize {
        self.mean.len()
    }

    /// Half the trunk's depth at one of [`RIBS`], in the body that has these features [m].
    pub fn half_depth(&self, features: &[DVec3], rib: usize) -> f64 {
        let first = self.joints.len() + self.shares.len() + 2 * rib;
        0.5 * features[first].distance(features[first + 1])
    }

    /// The group called `name`.
    pub fn group(&self, name: &str) -> Option<usize> {
        self.groups.iter().position(|g| g == name)
    }

    /// Adds the features of the body with these phenotypes, without sliders [m].
    pub fn add_phenotypes(&self, phenotypes: &[f64; 11], features: &mut [DVec3]) {
        features
            .iter_mut()
            .zip(&self.mean)
            .for_each(|(f, m)| *f += *m);
        let weights = self.blend.weights(phenotypes);
        for (mode, w) in self.modes.chunks(self.n_features()).zip(weights) {
            features
                .iter_mut()
                .zip(mode)
                .for_each(|(f, m)| *f += w * *m);
        }
    }

    /// `∂features/∂phenotype` for each phenotype in `which`.
    pub fn slopes(&self, phenotypes: &[f64; 11], which: &[usize]) -> Vec<Vec<DVec3>> {
        let mut slopes = vec![vec![DVec3::ZERO; self.n_features()]; which.len()];
        if which.is_empty() {
            return slopes;
        }
        let by_mode = self.blend.slopes(phenotypes);
        for (mode, row) in self.modes.chunks(self.n_features()).zip(by_mode) {
            for (slope, &k) in slopes.iter_mut().zip(which) {
                slope
                    .iter_mut()
                    .zip(mode)
                    .for_each(|(s, m)| *s += row[k] * *m);
            }
        }
        slopes
    }

    /// How features move when the slider called `name` goes up by one, and down by one.
    pub fn slider(&self, avatar: &Avatar, name: &str) -> Result<[Vec<DVec3>; 2], FitError> {
        let (target, sense) = avatar.target(name)?;
        let moved = |list: &[(u32, [f32; 3])]| -> Vec<DVec3> {
            let at = |p: u32| {
                list.binary_search_by_key(&p, |d| d.0)
                    .map(|i| lift(list[i].1))
            };
            let sum =
                |f: &Vec<(u32, f64)>| f.iter().map(|&(p, w)| w * at(p).unwrap_or_default()).sum();
            self.points.iter().map(sum).collect()
        };
        let sides = [moved(&target.up), moved(&target.down)];
        let [up, down] = sides;
        Ok(if sense < 0.0 { [down, up] } else { [up, down] })
    }
}

fn lift(d: [f32; 3]) -> DVec3 {
    DVec3::from(d.map(f64::from))
}

/// The joints in the rig's order, and the names of their groups.
fn joints(avatar: &Avatar) -> Result<(Vec<Joint>, Vec<String>), FitError> {
    let mut named: Vec<(usize, String)> = Vec::new();
    for (bone, group) in BONES {
        named.push((avatar.bone(bone)?, group.to_string()));
    }
    for side in ["L", "R"] {
        for (bone, group) in PAIRED {
            named.push((
                avatar.bone(&format!("{bone}.{side}"))?,
                format!("{group}.{side}"),
            ));
        }
    }
    named.sort();
    let mut groups: Vec<String> = Vec::new();
    let mut joints: Vec<Joint> = Vec::new();
    for (bone, name) in named {
        let group = groups
            .iter()
            .position(|g| *g == name)
            .unwrap_or(groups.len());
        if group == groups.len() {
            groups.push(name);
        }
        let parent = nearest(avatar, avatar.rig().bones[bone].parent, &joints);
        joints.push(Joint {
            bone,
            parent,
            group,
        });
    }
    Ok((joints, groups))
}

/// The joint at `bone` or at its nearest ancestor that is a joint.
fn nearest(avatar: &Avatar, mut bone: Option<usize>, joints: &[Joint]) -> Option<usize> {
    while let Some(b) = bone {
        if let Some(j) = joints.iter().position(|j| j.bone == b) {
            return Some(j);
        }
        bone = avatar.rig().bones[b].parent;
    }
    None
}

/// The joint that carries each bone of the rig.
fn owners(avatar: &Avatar, joints: &[Joint]) -> Vec<usize> {
    let bones = 0..avatar.rig().n_bones();
    bones
        .map(|b| nearest(avatar, Some(b), joints).unwrap_or(0))
        .collect()
}

/// Per joint the weighted vertices of a marker.
type Sums = BTreeMap<usize, Vec<(u32, f64)>>;

/// The shares of every marker.
fn markers(avatar: &Avatar, owner: &[usize], ribs: &[Rib]) -> Result<Vec<Sums>, FitError> {
    let mut markers = Vec::new();
    for row in avatar.regressors().rows() {
        let mut sums = Sums::new();
        for &(v, r) in row {
            for &(b, w) in avatar.rig().weights.row(v as usize) {
                sums.entry(owner[b as usize]).or_default().push((v, r * w));
            }
        }
        markers.push(sums);
    }
    for name in KNUCKLES {
        let bone = avatar.bone(name)?;
        let point = (avatar.head_point(bone) as u32, 1.0);
        markers.push(Sums::from([(owner[bone], vec![point])]));
    }
    for end in ribs.iter().flatten() {
        // Where bars are is rough anyway; one joint for each keeps the body small.
        let row = avatar.rig().weights.row(end[0] as usize).iter();
        let most = row.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |m| m.0);
        let points = end.map(|v| (v, 0.5)).to_vec();
        markers.push(Sums::from([(owner[most as usize], points)]));
    }
    Ok(markers)
}

/// Left and right end of a bar across the trunk: a vertex before it and one behind.
type Rib = [[u32; 2]; 2];

/// The bars of the mean body's trunk, belly first.
fn ribs(avatar: &Avatar, joints: &[Joint], owner: &[usize]) -> Vec<Rib> {
    let (mean, weights) = (avatar.mean(), &avatar.rig().weights);
    let trunk = BONES.map(|(bone, _)| bone);
    let on_trunk = |v: &usize| {
        let most = weights.row(*v).iter().max_by(|a, b| a.1.total_cmp(&b.1));
        most.is_some_and(|m| {
            let bone = joints[owner[m.0 as usize]].bone;
            trunk.contains(&avatar.rig().bones[bone].name.as_str())
        })
    };
    let skin: Vec<usize> = avatar
        .part(muslin_body::Part::Body)
        .filter(on_trunk)
        .collect();
    let marker = |k: usize| {
        let row = avatar.regressors().row(k);
        row.iter()
            .map(|&(v, w)| w * mean[v as usize].y)
            .sum::<f64>()
    };
    let (hips, shoulders) = (marker(11), marker(5));
    let rib = |share: f64| {
        let level = hips + share * (shoulders - hips);
        let slice = skin
            .iter()
            .copied()
            .filter(|&v| (mean[v].y - level).abs() < 0.02);
        let slice: Vec<usize> = slice.collect();
        let reach =
            |f: &dyn Fn(DVec3) -> f64| slice.iter().map(|&v| f(mean[v])).fold(0.0, f64::max);
        let half_depth = 0.5 * (reach(&|v| v.z) + reach(&|v| -v.z));
        let end = (reach(&|v| v.x) - half_depth).max(0.02);
        [1.0, -1.0].map(|side| {
            [1.0, -1.0].map(|face| {
                let score = |v: &usize| face * mean[*v].z - 4.0 * (mean[*v].x - side * end).abs();
                let best = slice.iter().max_by(|a, b| score(a).total_cmp(&score(b)));
                best.map_or(0, |v| *v as u32)
            })
        })
    };
    RIBS.map(rib).to_vec()
}

/// The highest and the lowest point of the mean body.
fn crown_and_sole(avatar: &Avatar) -> [u32; 2] {
    let skin = avatar.part(muslin_body::Part::Body);
    let y = |v: &u32| avatar.mean()[*v as usize].y;
    let skin = || {
        (skin.start as u32..skin.end as u32)
            .collect::<Vec<_>>()
            .into_iter()
    };
    let crown = skin().max_by(|a, b| y(a).total_cmp(&y(b)));
    let sole = skin().min_by(|a, b| y(a).total_cmp(&y(b)));
    [crown.unwrap_or(0), sole.unwrap_or(0)]
}
