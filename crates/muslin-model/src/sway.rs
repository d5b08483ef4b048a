//! What a model knows of how its cloth swings.

/// Swings of cloth about where it would rest: its slowest shapes of vibration, and a few points whose
/// motion stands for that of the whole.
///
/// `x = skin(still + Φ q)`, and `q` obeys Newton's law for that `x`: inertia of the points, stiffness
/// `ω²` and damping of each swing. Nothing swings without motion, and nothing depends on the way the
/// body faces or on where it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sway {
    /// `Φ` [m at a code of one], around the body at rest: for every coordinate of every vertex a row
    /// with one entry per swing. Of unit mass: `Φᵀ M Φ` is the identity.
    pub shapes: Vec<f32>,
    /// `ω²` of each swing [1/s²].
    pub stiffness: Vec<f32>,
    /// How fast each swing dies away [1/s].
    pub damping: Vec<f32>,
    /// Vertices whose motion stands for that of the cloth around them.
    pub samples: Vec<u32>,
    /// Mass of the cloth that each stands for [kg].
    pub masses: Vec<f32>,
    /// Its mean share in the swings: like `shapes`, for every coordinate of every sample a row.
    pub means: Vec<f32>,
    /// What holds it back.
    pub walls: Vec<Wall>,
}

/// Skin below a vertex, which swings do not take it through.
///
/// In a pose the skin there is a plane: its point and the way out of it are carried by the skin's own bones,
/// however the pose lays the cloth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wall {
    /// The vertex.
    pub vertex: u32,
    /// The skin's point at rest [m].
    pub foot: [f32; 3],
    /// The unit way out of the skin there.
    pub out: [f32; 3],
    /// Bones that the point follows, as indices into [`Model::bones`](crate::Model::bones), and how strongly.
    pub bones: [u8; FOLLOWED],
    /// Their weights, which sum to one.
    pub weights: [f32; FOLLOWED],
}

/// Bones that a point of the skin follows, at most.
pub const FOLLOWED: usize = 4;

impl Wall {
    /// Whether it holds what it may, below a cloth of `n` vertices on so many bones.
    fn fits(&self, n: usize, bones: usize) -> bool {
        let sum: f32 = self.weights.iter().sum();
        (self.vertex as usize) < n
            && self.bones.iter().all(|b| usize::from(*b) < bones)
            && self.foot.iter().chain(&self.out).all(|x| x.is_finite())
            && self.weights.iter().all(|w| *w >= 0.0)
            && (sum - 1.0).abs() < 1e-3
    }
}

/// Swings at most: playing them inverts a matrix of this size.
const MOST: usize = 256;

impl Sway {
    /// How many swings there are.
    pub fn len(&self) -> usize {
        self.stiffness.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.stiffness.is_empty()
    }

    /// Whether the arrays fit each other and a cloth of `n` vertices on so many bones, and hold what they may.
    pub fn fits(&self, n: usize, bones: usize) -> bool {
        let (k, m) = (self.len(), self.samples.len());
        let all = [
            &self.shapes,
            &self.stiffness,
            &self.damping,
            &self.masses,
            &self.means,
        ];
        // What stands for the cloth and what is held back are vertices, each at most once.
        k <= MOST
            && m <= n
            && self.walls.len() <= n
            && self.shapes.len() == 3 * n * k
            && self.means.len() == 3 * m * k
            && self.damping.len() == k
            && self.masses.len() == m
            && self.samples.iter().all(|v| (*v as usize) < n)
            && self.walls.iter().all(|w| w.fits(n, bones))
            && all.iter().all(|a| a.iter().all(|x| x.is_finite()))
            && [&self.stiffness, &self.damping, &self.masses]
                .iter()
                .all(|a| a.iter().all(|x| *x >= 0.0))
            && (k == 0 || self.masses.iter().any(|m| *m > 0.0))
    }
}
