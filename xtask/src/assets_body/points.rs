//! Which vertices are kept, and where the bones' ends are among them.

use super::mesh::{self, Base};
use super::source::{Bone, Place};
use glam::DVec3;
use muslin_body::{Part, PartCounts};
use std::collections::BTreeMap;

/// Kept vertices in their new order, then the anchors of the bones.
pub struct Points {
    pub counts: PartCounts,
    /// How many vertices the source has.
    pub n_source: usize,
    /// The source's index of every kept vertex.
    pub kept: Vec<u32>,
    new: Vec<Option<u32>>,
    /// The source vertices that each anchor is the middle of.
    anchors: Vec<Vec<u32>>,
    ends: Vec<[u32; 2]>,
}

impl Points {
    pub fn new(base: &Base, rig: &[Bone]) -> Self {
        let mut kept = Vec::new();
        let mut part = |p: Part| {
            let before = kept.len();
            kept.extend(
                verts_of(base, mesh::groups(p))
                    .into_iter()
                    .filter(|&v| !mesh::is_plain(v)),
            );
            kept.len() - before
        };
        let counts = PartCounts {
            body: part(Part::Body),
            eyes: part(Part::Eyes),
            tights: part(Part::Tights),
            skirt: part(Part::Skirt),
        };
        let mut new = vec![None; base.verts.len()];
        kept.iter()
            .enumerate()
            .for_each(|(k, &v)| new[v as usize] = Some(k as u32));
        let (anchors, ends) = anchors(base, rig);
        Self {
            counts,
            n_source: base.verts.len(),
            kept,
            new,
            anchors,
            ends,
        }
    }

    /// The new index of a source vertex.
    pub fn new_of(&self, v: u32) -> Option<u32> {
        self.new[v as usize]
    }

    /// New indices of source vertices that are known to be kept.
    pub fn verts(&self, source: &[u32]) -> Vec<u32> {
        source
            .iter()
            .map(|&v| self.new_of(v).expect("only kept vertices are asked for"))
            .collect()
    }

    /// Quads over the new indices.
    pub fn quads(&self, source: &[[u32; 4]]) -> Vec<[u32; 4]> {
        source
            .iter()
            .map(|q| q.map(|v| self.new_of(v).expect("faces use kept vertices")))
            .collect()
    }

    /// The rig over the anchors.
    pub fn bones(&self, rig: &[Bone]) -> Vec<muslin_body::Bone> {
        let bone = |(b, &[head, tail]): (&Bone, &[u32; 2])| muslin_body::Bone {
            name: b.name.clone(),
            parent: b.parent,
            head,
            tail,
        };
        rig.iter().zip(&self.ends).map(bone).collect()
    }

    /// Where all points are on the source's own template [m].
    pub fn template(&self, base: &Base) -> Vec<DVec3> {
        self.gather(
            &base
                .verts
                .iter()
                .map(|v| DVec3::from(*v))
                .collect::<Vec<_>>(),
        )
    }

    /// A value for every source vertex becomes one for every point; anchors get the middle.
    pub fn gather(&self, values: &[DVec3]) -> Vec<DVec3> {
        let middle =
            |a: &Vec<u32>| a.iter().map(|&v| values[v as usize]).sum::<DVec3>() / a.len() as f64;
        let verts = self.kept.iter().map(|&v| values[v as usize]);
        verts.chain(self.anchors.iter().map(middle)).collect()
    }
}

fn verts_of(base: &Base, groups: &[&str]) -> Vec<u32> {
    let faces = groups.iter().filter_map(|g| base.groups.get(*g));
    let mut verts: Vec<u32> = faces
        .flat_map(|f| f.quads.iter().flatten().copied())
        .collect();
    verts.sort_unstable();
    verts.dedup();
    verts
}

/// Every different place once, and which of them each bone's head and tail are.
fn anchors(base: &Base, rig: &[Bone]) -> (Vec<Vec<u32>>, Vec<[u32; 2]>) {
    let mut known: BTreeMap<Place, u32> = BTreeMap::new();
    let mut list = Vec::new();
    let mut index = |place: &Place| {
        *known.entry(place.clone()).or_insert_with(|| {
            list.push(match place {
                Place::Verts(v) => v.clone(),
                Place::Cube(name) => verts_of(base, &[name]),
            });
            list.len() as u32 - 1
        })
    };
    let ends = rig
        .iter()
        .map(|b| [index(&b.head), index(&b.tail)])
        .collect();
    (list, ends)
}
