//! What a law answers: energy, gradient, Hessian, on a point, on a triangle, on N vertices.

use glam::{DMat3, DVec3};

use crate::RestTriangle;

/// `a bᵀ`.
#[inline]
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// A law's answer on the `N` vertices of its stencil.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Local<const N: usize> {
    /// Energy [J].
    pub energy: f64,
    /// Gradient per vertex [N].
    pub gradient: [DVec3; N],
    /// Hessian block `[i][j] = ∂²E/∂xᵢ∂xⱼ` [N/m]; `[j][i]` is its transpose.
    pub hessian: [[DMat3; N]; N],
}

impl<const N: usize> Local<N> {
    /// Nothing: what a law answers where it does not act.
    pub const ZERO: Self = Self {
        energy: 0.0,
        gradient: [DVec3::ZERO; N],
        hessian: [[DMat3::ZERO; N]; N],
    };

    /// The answer of `E = f(q)` whose `∇q` is `g`, with the Gauss-Newton Hessian `curvature g gᵀ`.
    #[inline]
    pub fn rank_one(energy: f64, slope: f64, curvature: f64, g: &[DVec3; N]) -> Self {
        let mut out = Self::ZERO;
        out.energy = energy;
        for i in 0..N {
            out.gradient[i] = g[i] * slope;
            let row = g[i] * curvature;
            for j in i..N {
                let block = outer(row, g[j]);
                out.hessian[i][j] = block;
                out.hessian[j][i] = block.transpose();
            }
        }
        out
    }
}

/// A law's answer on one point `r = Σ wᵢ xᵢ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtPoint {
    /// Energy [J].
    pub energy: f64,
    /// `∂E/∂r` [N].
    pub gradient: DVec3,
    /// `∂²E/∂r²` [N/m], symmetric.
    pub hessian: DMat3,
}

impl AtPoint {
    /// Nothing: what a law answers where it does not act.
    pub const ZERO: Self = Self {
        energy: 0.0,
        gradient: DVec3::ZERO,
        hessian: DMat3::ZERO,
    };

    /// Hands the answer to the vertices whose weighted sum the point is.
    #[inline]
    pub fn spread<const N: usize>(&self, weights: &[f64; N]) -> Local<N> {
        let mut out = Local::ZERO;
        out.energy = self.energy;
        for i in 0..N {
            out.gradient[i] = self.gradient * weights[i];
            for j in 0..N {
                out.hessian[i][j] = self.hessian * (weights[i] * weights[j]);
            }
        }
        out
    }
}

/// A law's answer on a triangle, per rest area and with respect to the deformation `F`'s columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InPlane {
    /// Energy density [J/m²].
    pub energy: f64,
    /// `∂ψ/∂F`, the stress [N/m], by column: weft, warp.
    pub stress: [DVec3; 2],
    /// `∂²ψ/∂F²` [N/m]: weft-weft, weft-warp (rows weft, columns warp), warp-warp.
    pub hessian: [DMat3; 3],
}

impl InPlane {
    /// Nothing: what a law answers where it does not act.
    pub const ZERO: Self = Self {
        energy: 0.0,
        stress: [DVec3::ZERO; 2],
        hessian: [DMat3::ZERO; 3],
    };

    /// Adds another law's answer on the same triangle.
    #[inline]
    pub fn add(&mut self, other: &Self) {
        self.energy += other.energy;
        for i in 0..2 {
            self.stress[i] += other.stress[i];
        }
        for i in 0..3 {
            self.hessian[i] += other.hessian[i];
        }
    }

    /// Adds `k d dᵀ` for a direction `d` of deformation space, given by its two columns.
    #[inline]
    pub(crate) fn add_outer(&mut self, k: f64, d: [DVec3; 2]) {
        let scaled = [d[0] * k, d[1] * k];
        self.hessian[0] += outer(scaled[0], d[0]);
        self.hessian[1] += outer(scaled[0], d[1]);
        self.hessian[2] += outer(scaled[1], d[1]);
    }

    /// Hands the answer to the triangle's vertices; times the rest area.
    #[inline]
    pub fn spread(&self, rest: &RestTriangle) -> Local<3> {
        let (_, gradient) = spread_stress(self.energy, self.stress, rest);
        let h = |i, j| self.block(rest, i, j);
        let (h11, h12, h22) = (h(1, 1), h(1, 2), h(2, 2));
        // Moving all three together changes nothing, so each row of blocks sums to zero.
        let (h10, h20) = (-(h11 + h12), -(h12.transpose() + h22));
        let h00 = -(h10 + h20);
        Local {
            energy: self.energy * rest.area,
            gradient,
            hessian: [
                [h00, h10.transpose(), h20.transpose()],
                [h10, h11, h12],
                [h20, h12.transpose(), h22],
            ],
        }
    }

    #[inline]
    fn block(&self, rest: &RestTriangle, i: usize, j: usize) -> DMat3 {
        let ([ui, vi], [uj, vj]) = (rest.slope(i), rest.slope(j));
        let [uu, uv, vv] = &self.hessian;
        (*uu * (ui * uj) + *uv * (ui * vj) + uv.transpose() * (vi * uj) + *vv * (vi * vj))
            * rest.area
    }
}

/// Energy [J] and vertex gradients [N] of a density [J/m²] and its stress [N/m].
#[inline]
pub(crate) fn spread_stress(
    density: f64,
    stress: [DVec3; 2],
    rest: &RestTriangle,
) -> (f64, [DVec3; 3]) {
    let at = |i| {
        let [u, v] = rest.slope(i);
        (stress[0] * u + stress[1] * v) * rest.area
    };
    let (g1, g2) = (at(1), at(2));
    (density * rest.area, [-(g1 + g2), g1, g2])
}
