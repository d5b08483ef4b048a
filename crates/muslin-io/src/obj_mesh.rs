//! OBJ in: triangles of one mesh from the plainest 3D format.
//!
//! Vertices (`v`), texture places (`vt`) and faces (`f`) are read; groups, materials, normals,
//! lines and curves are left alone. Faces with more than three corners are cut into triangles, quads
//! along their shorter diagonal. Indices may count from the end (negative).

use glam::{DVec2, DVec3};
use muslin_geom::Mesh;

use crate::error::{Fault, IoError, Place};

/// A mesh as the file has it, in the file's units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjMesh {
    /// Vertices in the file's order, and triangles.
    pub mesh: Mesh,
    /// Texture places of every face's corners, where every face has them.
    pub uv: Option<Vec<[DVec2; 3]>>,
}

const MAX_BYTES: usize = 256 << 20;
const MAX_VERTS: usize = 2_000_000;
const MAX_CORNERS: usize = 64;

/// Reads an OBJ file; `name` is what errors call it.
pub fn read_obj(name: &str, bytes: &[u8]) -> Result<ObjMesh, IoError> {
    if bytes.len() > MAX_BYTES {
        let fault = Fault::new("obj-large", name, "too large for a mesh");
        return Err(fault.found(bytes.len()).allowed(MAX_BYTES).refused());
    }
    let text = String::from_utf8_lossy(bytes);
    let mut reader = Reader::default();
    for (number, line) in text.lines().enumerate() {
        reader.line(line).map_err(|bad| {
            let fault = Fault::new("obj", name, bad.what).at(Place::Line(number + 1));
            let fault = fault.found(bad.found).allowed(bad.allowed);
            match bad.limit {
                true => fault.refused(),
                false => fault.hint("export the mesh as OBJ again").invalid(),
            }
        })?;
    }
    if reader.mesh.faces.is_empty() {
        let fault = Fault::new("obj-empty", name, "no face in this file");
        return Err(fault.hint("name an OBJ file that holds a mesh").invalid());
    }
    let whole = reader.uv.len() == reader.mesh.faces.len();
    Ok(ObjMesh {
        mesh: reader.mesh,
        uv: whole.then_some(reader.uv),
    })
}

#[derive(Default)]
struct Reader {
    mesh: Mesh,
    places: Vec<DVec2>,
    uv: Vec<[DVec2; 3]>,
}

#[derive(Default)]
struct Bad {
    what: String,
    found: String,
    allowed: String,
    limit: bool,
}

fn bad(what: &str, found: &str) -> Bad {
    Bad {
        what: what.into(),
        found: found.into(),
        ..Bad::default()
    }
}

impl Reader {
    fn line(&mut self, line: &str) -> Result<(), Bad> {
        let line = line.split('#').next().unwrap_or_default();
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let [x, y, z] = numbers(words)?;
                if self.mesh.verts.len() >= MAX_VERTS {
                    return Err(Bad {
                        limit: true,
                        allowed: MAX_VERTS.to_string(),
                        ..bad("too many vertices", "")
                    });
                }
                self.mesh.verts.push(DVec3::new(x, y, z));
                Ok(())
            }
            Some("vt") => {
                let [x, y] = numbers(words)?;
                self.places.push(DVec2::new(x, y));
                Ok(())
            }
            Some("f") => self.face(words),
            _ => Ok(()),
        }
    }

    fn face<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Result<(), Bad> {
        let mut corners: Vec<(u32, Option<u32>)> = Vec::new();
        for word in words {
            let mut parts = word.split('/');
            let v = index(parts.next(), self.mesh.verts.len(), word)?;
            let v = v.ok_or_else(|| bad("a face without a vertex", word))?;
            let t = index(parts.next(), self.places.len(), word)?;
            corners.push((v, t));
        }
        if corners.len() < 3 || corners.len() > MAX_CORNERS {
            return Err(Bad {
                allowed: format!("3 to {MAX_CORNERS}"),
                ..bad("another number of corners", &corners.len().to_string())
            });
        }
        for tri in self.cut(&corners) {
            self.mesh.faces.push(tri.map(|c| c.0));
            if let [Some(a), Some(b), Some(c)] = tri.map(|c| c.1) {
                self.uv.push([a, b, c].map(|t| self.places[t as usize]));
            }
        }
        Ok(())
    }

    fn cut(&self, c: &[(u32, Option<u32>)]) -> Vec<[(u32, Option<u32>); 3]> {
        let at = |k: usize| self.mesh.verts[c[k].0 as usize];
        if c.len() == 4 && at(1).distance(at(3)) < at(0).distance(at(2)) {
            return vec![[c[0], c[1], c[3]], [c[1], c[2], c[3]]];
        }
        (1..c.len() - 1).map(|k| [c[0], c[k], c[k + 1]]).collect()
    }
}

/// The first `N` numbers; more are left alone, as colours after positions.
fn numbers<'a, const N: usize>(mut words: impl Iterator<Item = &'a str>) -> Result<[f64; N], Bad> {
    let mut out = [0.0; N];
    for o in &mut out {
        let word = words.next().ok_or_else(|| bad("a number is missing", ""))?;
        let number = word.parse::<f64>().ok();
        let usable = number.filter(|x| x.is_finite() && x.abs() < 1e9);
        *o = usable.ok_or_else(|| bad("not a usable number", word))?;
    }
    Ok(out)
}

/// An index from 1, or from the end where negative; none where nothing stands.
fn index(part: Option<&str>, count: usize, word: &str) -> Result<Option<u32>, Bad> {
    let text = match part {
        None | Some("") => return Ok(None),
        Some(text) => text,
    };
    let n: i64 = text.parse().map_err(|_| bad("not an index", word))?;
    let at = if n < 0 { count as i64 + n } else { n - 1 };
    if n == 0 || at < 0 || at >= count as i64 {
        return Err(Bad {
            allowed: format!("1 to {count}, so far"),
            ..bad("an index points at nothing", word)
        });
    }
    Ok(Some(at as u32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quads_places_and_counts_from_the_end_are_read() {
        let text = "# a\nv 0 0 0 1 1 1\nv 1 0 0\nv 1 3 0\nv 0 1 0\nvt 0 0\nvt 1 0 0\nvt 1 1\nvt 0 1\n\
                    g x\nf 1/1/9 2/2 3/3 4/4\nf -4/-4 -3/-3 -2/-2\n";
        let got = read_obj("a.obj", text.as_bytes()).expect("valid");
        assert_eq!(got.mesh.faces, [[0, 1, 3], [1, 2, 3], [0, 1, 2]]);
        let uv = got.uv.expect("all faces have places");
        assert_eq!(uv[1], [DVec2::X, DVec2::ONE, DVec2::Y]);
    }

    #[test]
    fn bad_files_are_named_by_line() {
        let cases = [
            ("v 0 0\n", "a.obj:1: a number is missing"),
            ("v 0 0 nan\n", "a.obj:1: not a usable number (found nan)"),
            (
                "v 0 0 0\nf 1 2 3\n",
                "a.obj:2: an index points at nothing (found 2, allowed 1 to 1, so far)",
            ),
            ("v 0 0 0\nf 1 1\n", "a.obj:2: another number of corners"),
            ("v 0 0 0\nf 0 1 1\n", "points at nothing"),
            ("v 0 0 0\nf x 1 1\n", "not an index"),
            ("hello", "no face in this file"),
        ];
        for (text, want) in cases {
            let err = read_obj("a.obj", text.as_bytes()).expect_err(want);
            assert!(err.to_string().contains(want), "{err}");
            assert_eq!(err.exit_code(), 3);
        }
    }
}
