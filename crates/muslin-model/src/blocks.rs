//! Cloth in blocks of sixteen vertices that lie beside each other and follow the same few bones.

use crate::fans::Fans;
use crate::shapes::{Shapes, neighbours};
use crate::{Model, Skin};

/// Vertices in a block.
pub(crate) const WIDE: usize = 16;

/// One number of every vertex of a block.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Wide(pub [f32; WIDE]);

/// Everything of a model that depends on the vertex.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    /// How many vertices there are; places beyond them belong to none.
    pub n_verts: usize,
    /// The vertex at each place, and the place of each vertex.
    pub order: Vec<u32>,
    pub places: Vec<u32>,
    /// Template and constant shape of each block, by axis [m].
    pub base: Vec<[Wide; 3]>,
    pub shapes: Shapes,
    /// Where each block's bones start, and the end of the last.
    pub starts: Vec<u32>,
    /// The bones that any vertex of a block follows.
    pub bones: Vec<u8>,
    /// How much each vertex follows each of them.
    pub weights: Vec<Wide>,
    /// Where the bones of the vertex at each place start in `followed`, and the end of the last.
    pub follows: Vec<u32>,
    /// Bones of single vertices, and how much they follow them.
    pub followed: Vec<(u32, f32)>,
    /// Faces and neighbours, by places.
    pub faces: Vec<[u32; 3]>,
    pub fans: Fans,
}

impl Blocks {
    /// Of a model; all of its shapes in 16 bits where they must be `exact`.
    pub fn new(model: &Model, exact: bool) -> Self {
        let order = neighbours(&model.template);
        let mut out = Self {
            n_verts: model.n_verts(),
            shapes: Shapes::new(model, &order, exact),
            order: Vec::new(),
            places: vec![0; model.n_verts()],
            base: Vec::new(),
            starts: vec![0],
            bones: Vec::new(),
            weights: Vec::new(),
            follows: vec![0],
            followed: Vec::new(),
            faces: Vec::new(),
            fans: Fans::default(),
        };
        let laid = model.laid();
        for (place, v) in order.iter().enumerate() {
            out.places[*v as usize] = place as u32;
        }
        for verts in order.chunks(WIDE) {
            out.lay((model, &laid), verts);
            out.follow(&model.skin, verts);
        }
        let placed = |f: &[u32; 3]| f.map(|v| out.places[v as usize]);
        let mut faces: Vec<[u32; 3]> = model.faces.iter().map(placed).collect();
        // In the order of memory.
        faces.sort_by_key(|f| f.iter().copied().min());
        (out.fans, out.faces) = (Fans::new(&faces, out.n_verts), faces);
        out.order = order;
        out
    }

    /// Adds a block of a model that lies there at rest [m].
    fn lay(&mut self, (model, laid): (&Model, &[[f32; 3]]), verts: &[u32]) {
        let (n, constant) = (model.n_codes(), model.n_codes() - 1);
        let mut base = [Wide::default(); 3];
        for (i, &v) in verts.iter().enumerate() {
            for axis in 0..3 {
                let fixed = model.modes[(3 * v as usize + axis) * n + constant];
                base[axis].0[i] = laid[v as usize][axis] + fixed;
            }
        }
        self.base.push(base);
    }

    /// Adds the bones of a block.
    fn follow(&mut self, skin: &Skin, verts: &[u32]) {
        let all = verts.iter().flat_map(|v| skin.row(*v as usize));
        let mut bones: Vec<usize> = all.filter(|e| e.1 != 0.0).map(|e| e.0).collect();
        bones.sort_unstable();
        bones.dedup();
        for &b in &bones {
            let mut row = Wide::default();
            for (to, &v) in row.0.iter_mut().zip(verts) {
                *to = skin.row(v as usize).filter(|e| e.0 == b).map(|e| e.1).sum();
            }
            self.bones.push(b as u8);
            self.weights.push(row);
        }
        self.starts.push(self.bones.len() as u32);
        for &v in verts {
            let own = skin.row(v as usize).filter(|e| e.1 != 0.0);
            let first = self.followed.len();
            self.followed.extend(own.map(|(b, w)| (b as u32, w)));
            // As a block's bones, so that sums are the same to the last bit.
            self.followed[first..].sort_by_key(|e| e.0);
            self.follows.push(self.followed.len() as u32);
        }
    }
}
