//! A stranger's mesh made whole: welded, without debris, of one orientation, in its pieces.

use crate::GarmentError;
use glam::DVec3;
use muslin_geom::Mesh;
use std::collections::HashMap;

/// A connected piece of cloth.
pub struct Piece {
    /// In the file's units, oriented alike throughout.
    pub mesh: Mesh,
    /// Its openings, each a loop of vertices; small holes left out.
    pub rims: Vec<Vec<u32>>,
}

impl Piece {
    /// Whether it has one opening only, as what a hand or a foot goes into.
    pub fn ends(&self) -> bool {
        self.rims.len() == 1
    }
}

/// Vertices closer than this share of the mesh's size are one.
const WELD: f64 = 1e-6;
/// Pieces with fewer than this share of the faces are debris: buttons, buckles.
const DEBRIS: f64 = 0.02;
/// A hole whose rim is shorter than this share of the longest, or has so few sides, is damage, not
/// an opening; whatever its sides, one that is longer than the larger share is for the body.
const HOLE: f64 = 0.04;
const SIDES: usize = 7;
const OPENING: f64 = 0.25;

/// The pieces of a mesh, largest first.
pub fn pieces(mesh: &Mesh, warnings: &mut Vec<String>) -> Result<Vec<Piece>, GarmentError> {
    let welded = weld(mesh, warnings);
    let mut parts = split(&welded);
    parts.sort_by_key(|p| std::cmp::Reverse(p.faces.len()));
    let least = (DEBRIS * welded.faces.len() as f64).max(8.0) as usize;
    let all = parts.len();
    parts.retain(|p| p.faces.len() >= least);
    if parts.is_empty() {
        return Err(unfit(
            "there is no cloth in it: no piece has more than a few triangles",
        ));
    }
    if parts.len() < all {
        let n = all - parts.len();
        warnings.push(format!("{n} small loose pieces (buttons?) are left out"));
    }
    if parts.len() > MOST {
        let what = format!(
            "it falls into {} pieces; weld its vertices first",
            parts.len()
        );
        return Err(unfit(&what));
    }
    parts.into_iter().map(|p| piece(p, warnings)).collect()
}

/// More pieces than this are not an outfit but an unwelded mesh.
const MOST: usize = 6;

fn unfit(what: &str) -> GarmentError {
    GarmentError::Mesh { what: what.into() }
}

fn weld(mesh: &Mesh, warnings: &mut Vec<String>) -> Mesh {
    let size = extent(&mesh.verts).max(f64::MIN_POSITIVE);
    let key = |v: &DVec3| (*v / (WELD * size)).round().to_array().map(|x| x as i64);
    let mut known: HashMap<[i64; 3], u32> = HashMap::new();
    let mut verts = Vec::new();
    let mut used = vec![u32::MAX; mesh.verts.len()];
    mesh.faces
        .as_flattened()
        .iter()
        .for_each(|&i| used[i as usize] = 0);
    // In the file's order, so that nothing is renumbered without need.
    for (v, number) in mesh.verts.iter().zip(&mut used) {
        if *number == 0 {
            *number = *known.entry(key(v)).or_insert_with(|| {
                verts.push(*v);
                verts.len() as u32 - 1
            });
        }
    }
    let before = used.iter().filter(|u| **u != u32::MAX).count();
    if before > verts.len() {
        let n = before - verts.len();
        warnings.push(format!("{n} doubled vertices are welded"));
    }
    let faces = mesh.faces.iter().map(|f| f.map(|i| used[i as usize]));
    let mut faces: Vec<[u32; 3]> = faces
        .filter(|f| f[0] != f[1] && f[1] != f[2] && f[2] != f[0])
        .collect();
    let sorted = |f: &[u32; 3]| {
        let mut f = *f;
        f.sort_unstable();
        f
    };
    let mut seen = std::collections::HashSet::new();
    let all = faces.len();
    faces.retain(|f| seen.insert(sorted(f)));
    if faces.len() < all {
        let n = all - faces.len();
        warnings.push(format!("{n} doubled triangles are left out"));
    }
    Mesh { verts, faces }
}

pub fn extent(verts: &[DVec3]) -> f64 {
    let low = verts.iter().fold(DVec3::MAX, |a, b| a.min(*b));
    let high = verts.iter().fold(DVec3::MIN, |a, b| a.max(*b));
    (high - low).length()
}

/// Connected pieces, each with vertices of its own.
fn split(mesh: &Mesh) -> Vec<Mesh> {
    let mut label: Vec<u32> = (0..mesh.verts.len() as u32).collect();
    for f in &mesh.faces {
        for k in 1..3 {
            let (a, b) = (root(&mut label, f[0]), root(&mut label, f[k]));
            label[a.max(b) as usize] = a.min(b);
        }
    }
    let mut number = HashMap::new();
    let mut parts: Vec<Mesh> = Vec::new();
    let mut own = vec![(0, 0); mesh.verts.len()];
    for (i, v) in mesh.verts.iter().enumerate() {
        let k = *number.entry(root(&mut label, i as u32)).or_insert_with(|| {
            parts.push(Mesh::default());
            parts.len() - 1
        });
        own[i] = (k, parts[k].verts.len() as u32);
        parts[k].verts.push(*v);
    }
    for f in &mesh.faces {
        parts[own[f[0] as usize].0]
            .faces
            .push(f.map(|i| own[i as usize].1));
    }
    parts
}

fn root(label: &mut [u32], mut i: u32) -> u32 {
    while label[i as usize] != i {
        label[i as usize] = label[label[i as usize] as usize];
        i = label[i as usize];
    }
    i
}

fn piece(mut mesh: Mesh, warnings: &mut Vec<String>) -> Result<Piece, GarmentError> {
    orient(&mut mesh, warnings)?;
    part_fans(&mut mesh);
    let mut rims = rims(&mesh.faces);
    if rims.is_empty() {
        let what = "it is closed: a solid or a doubled shell without an opening for the body; \
                    delete the inner side, or cut openings";
        return Err(unfit(what));
    }
    let length = |ring: &Vec<u32>| -> f64 {
        let at = |k: usize| mesh.verts[ring[k % ring.len()] as usize];
        (0..ring.len()).map(|k| at(k).distance(at(k + 1))).sum()
    };
    let longest = rims.iter().map(length).fold(0.0, f64::max);
    let all = rims.len();
    rims.retain(|r| {
        let share = length(r) / longest;
        share >= OPENING || (share >= HOLE && r.len() > SIDES)
    });
    if rims.len() < all {
        let n = all - rims.len();
        warnings.push(format!("{n} small holes in the cloth stay open"));
    }
    Ok(Piece { mesh, rims })
}

/// Sides as (smaller vertex, larger vertex, face, whether it runs upward), sorted.
fn sides(faces: &[[u32; 3]]) -> Vec<(u32, u32, u32, bool)> {
    let one = |(t, f): (usize, &[u32; 3])| {
        let f = *f;
        (0..3).map(move |k| {
            let (a, b) = (f[k], f[(k + 1) % 3]);
            (a.min(b), a.max(b), t as u32, a < b)
        })
    };
    let mut all: Vec<_> = faces.iter().enumerate().flat_map(one).collect();
    all.sort_unstable();
    all
}

/// Turns faces over until neighbours agree.
fn orient(mesh: &mut Mesh, warnings: &mut Vec<String>) -> Result<(), GarmentError> {
    let sides = sides(&mesh.faces);
    let mut near: Vec<Vec<(u32, bool)>> = vec![Vec::new(); mesh.faces.len()];
    let mut many = 0;
    for same in sides.chunk_by(|a, b| a.0 == b.0 && a.1 == b.1) {
        match same {
            [a, b] => {
                near[a.2 as usize].push((b.2, a.3 == b.3));
                near[b.2 as usize].push((a.2, a.3 == b.3));
            }
            [_] => {}
            _ => many += 1,
        }
    }
    if many > 0 {
        let what = format!(
            "{many} edges belong to more than two triangles; separate what is glued on there \
             (pockets, linings, double sides)"
        );
        return Err(unfit(&what));
    }
    let mut turned: Vec<Option<bool>> = vec![None; mesh.faces.len()];
    let mut open = Vec::new();
    for start in 0..mesh.faces.len() {
        if turned[start].is_none() {
            turned[start] = Some(false);
            open.push(start);
        }
        while let Some(t) = open.pop() {
            let own = turned[t].unwrap_or(false);
            for &(n, alike) in &near[t] {
                let want = own != alike;
                match turned[n as usize] {
                    None => {
                        turned[n as usize] = Some(want);
                        open.push(n as usize);
                    }
                    Some(is) if is != want => {
                        return Err(unfit("it has one side only, like a Möbius strip"));
                    }
                    Some(_) => {}
                }
            }
        }
    }
    let count = turned.iter().filter(|t| **t == Some(true)).count();
    if count > 0 {
        let n = count.min(mesh.faces.len() - count);
        warnings.push(format!(
            "{n} triangles looked the other way and are turned over"
        ));
    }
    for (f, t) in mesh.faces.iter_mut().zip(turned) {
        if t == Some(true) {
            f.swap(1, 2);
        }
    }
    Ok(())
}

/// Gives every fan of faces around a vertex a vertex of its own, so that pieces that touch in a
/// point come apart there.
fn part_fans(mesh: &mut Mesh) {
    let mut around: Vec<Vec<(u32, usize)>> = vec![Vec::new(); mesh.verts.len()];
    for (t, f) in mesh.faces.iter().enumerate() {
        (0..3).for_each(|k| around[f[k] as usize].push((t as u32, k)));
    }
    for i in 0..around.len() {
        let mut left = around[i].clone();
        let mut first = true;
        while let Some(start) = left.pop() {
            let mut fan = vec![start];
            let mut at = 0;
            while at < fan.len() {
                let [a, b] = [1, 2].map(|k| mesh.faces[fan[at].0 as usize][(fan[at].1 + k) % 3]);
                let near = |c: &(u32, usize)| {
                    let f = mesh.faces[c.0 as usize];
                    let [p, q] = [1, 2].map(|k| f[(c.1 + k) % 3]);
                    p == a || p == b || q == a || q == b
                };
                let (more, rest): (Vec<_>, Vec<_>) = left.into_iter().partition(near);
                fan.extend(more);
                left = rest;
                at += 1;
            }
            if !std::mem::take(&mut first) {
                let new = mesh.verts.len() as u32;
                mesh.verts.push(mesh.verts[i]);
                for (t, k) in fan {
                    mesh.faces[t as usize][k] = new;
                }
            }
        }
    }
}

/// The middle of a ring of vertices at `x`.
pub fn middle(x: &[DVec3], ring: &[u32]) -> DVec3 {
    ring.iter().map(|v| x[*v as usize]).sum::<DVec3>() / ring.len() as f64
}

/// Loops of open edges; where two meet in a vertex, either may go on.
pub fn rims(faces: &[[u32; 3]]) -> Vec<Vec<u32>> {
    let all = sides(faces);
    let open = all.chunk_by(|a, b| a.0 == b.0 && a.1 == b.1);
    let open = open.filter(|c| c.len() == 1).map(|c| match c[0].3 {
        true => (c[0].0, c[0].1),
        false => (c[0].1, c[0].0),
    });
    let mut next: HashMap<u32, Vec<u32>> = HashMap::new();
    let mut starts = Vec::new();
    for (a, b) in open {
        next.entry(a).or_default().push(b);
        starts.push(a);
    }
    let mut loops = Vec::new();
    for start in starts {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(to) = next.get_mut(&at).and_then(Vec::pop) {
            ring.push(at);
            at = to;
        }
        if ring.len() > 2 {
            loops.push(ring);
        }
    }
    loops
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An open tube of so many sides; every side with vertices of its own, one of them turned over.
    fn unwelded(n: u32) -> Mesh {
        let mut mesh = Mesh::default();
        let at = |k: u32, y: f64| {
            let t = f64::from(k % n) * std::f64::consts::TAU / f64::from(n);
            DVec3::new(t.cos(), y, t.sin())
        };
        for r in 0..3 {
            for k in 0..n {
                let (low, high) = (f64::from(r), f64::from(r) + 1.0);
                let i = mesh.verts.len() as u32;
                mesh.verts
                    .extend([at(k, low), at(k + 1, low), at(k + 1, high), at(k, high)]);
                mesh.faces.extend([[i, i + 2, i + 1], [i, i + 3, i + 2]]);
            }
        }
        mesh.faces[5].swap(0, 1);
        mesh
    }

    #[test]
    fn a_coarse_tube_is_as_open_as_a_fine_one() {
        let pieces = pieces(&unwelded(6), &mut Vec::new()).expect("a tube");
        assert_eq!(pieces[0].rims.len(), 2);
    }

    #[test]
    fn loose_faces_are_welded_and_turned_alike_and_it_is_said() {
        let mut told = Vec::new();
        let pieces = pieces(&unwelded(8), &mut told).expect("a tube");
        assert_eq!((pieces.len(), pieces[0].rims.len()), (1, 2));
        assert_eq!(pieces[0].mesh.verts.len(), 32);
        assert!(
            told[0].contains("welded") && told[1].contains("turned over"),
            "{told:?}"
        );
    }

    #[test]
    fn what_no_body_goes_through_is_refused_in_words() {
        let mut fin = unwelded(8);
        let n = fin.verts.len() as u32;
        fin.verts.push(DVec3::new(5.0, 0.0, 0.0));
        fin.faces.push([8 * 4, 8 * 4 + 1, n]);
        let mut told = Vec::new();
        let err = pieces(&fin, &mut told)
            .err()
            .expect("three faces on an edge");
        assert!(err.to_string().contains("more than two triangles"), "{err}");
        let mut lid = unwelded(8);
        for k in 1..7 {
            let corner = |k: u32| 4 * (k + 16) + 3;
            lid.faces.push([corner(0), corner(k), corner(k + 1)]);
        }
        let lid = pieces(&lid, &mut told).expect("a hat, a bag or a boot");
        assert!(lid[0].ends());
    }
}
