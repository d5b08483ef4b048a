//! OBJ out: the plainest 3D format, for tools that read no other.

use std::fmt::Write;

use crate::error::IoError;
use crate::scene::{Node, Scene};

/// The text of an `.obj` file: positions [m] to the micrometre, texture coordinates, normals.
///
/// The order of vertices and triangles is kept. Looks are left out.
pub fn obj(scene: &Scene) -> Result<String, IoError> {
    scene.check()?;
    let mut out = String::from("# Muslin; metres, Y up\n");
    let mut base = Base { vert: 1, uv: 1 };
    for node in &scene.nodes {
        append(&mut out, node, &base);
        base.vert += node.mesh.verts.len();
        base.uv += node.uvs.len();
    }
    Ok(out)
}

/// Numbers of a node's first vertex and first texture coordinate.
struct Base {
    vert: usize,
    uv: usize,
}

fn append(out: &mut String, node: &Node, base: &Base) {
    let mut line = |text: std::fmt::Arguments| {
        out.write_fmt(text).expect("a string takes all");
        out.push('\n');
    };
    line(format_args!("o {}", word(&node.name)));
    for v in &node.mesh.verts {
        line(format_args!("v {:.6} {:.6} {:.6}", v.x, v.y, v.z));
    }
    for uv in &node.uvs {
        line(format_args!("vt {:.6} {:.6}", uv.x, uv.y));
    }
    for n in node.normals_or_smooth().iter() {
        line(format_args!("vn {:.4} {:.4} {:.4}", n.x, n.y, n.z));
    }
    for face in &node.mesh.faces {
        let [a, b, c] = face.map(|i| {
            let (v, uv) = (base.vert + i as usize, base.uv + i as usize);
            if node.uvs.is_empty() {
                format!("{v}//{v}")
            } else {
                format!("{v}/{uv}/{v}")
            }
        });
        line(format_args!("f {a} {b} {c}"));
    }
}

/// A name in one word, which is all that OBJ knows.
fn word(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '_'
        }
    };
    name.chars().map(safe).collect()
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};
    use muslin_geom::Mesh;

    use super::*;

    #[test]
    fn two_things_share_one_count_of_vertices() {
        let mesh = Mesh {
            verts: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            faces: vec![[0, 1, 2]],
        };
        let plain = Node {
            name: "a b".into(),
            mesh,
            ..Node::default()
        };
        let uvs = vec![DVec2::ZERO, DVec2::X, DVec2::Y];
        let textured = Node {
            name: "c".into(),
            uvs,
            ..plain.clone()
        };
        let scene = Scene {
            nodes: vec![plain, textured],
            ..Scene::default()
        };
        let text = obj(&scene).expect("the scene is sound");
        let faces: Vec<&str> = text.lines().filter(|l| l.starts_with("f ")).collect();
        assert_eq!(faces, ["f 1//1 2//2 3//3", "f 4/1/4 5/2/5 6/3/6"]);
        assert!(
            text.contains("\no a_b\nv 0.000000 0.000000 0.000000\nv 1.000000"),
            "{text}"
        );
        assert!(text.contains("vn 0.0000 0.0000 1.0000"));
    }
}
