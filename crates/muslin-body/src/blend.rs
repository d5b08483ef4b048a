//! From phenotypes to the weights of the shape modes.
//!
//! A shape target stands for a corner of the phenotype grid: `male-old-maxmuscle-minweight`.
//! Each of its tags has the linear-interpolation weight of the phenotype's value between the
//! tag's anchor and the next, and the target counts by the product: piecewise multilinear.
//! The targets themselves are not stored. What is stored is their principal directions
//! (modes) and the matrix that gives the mode weights: `w = P c + bias`.

use crate::shape::ADULT;

/// Every tag a term may carry.
pub const TAGS: [&str; 23] = [
    "male",
    "female",
    "young",
    "old",
    "minmuscle",
    "averagemuscle",
    "maxmuscle",
    "minweight",
    "averageweight",
    "maxweight",
    "minheight",
    "maxheight",
    "idealproportions",
    "uncommonproportions",
    "mincup",
    "averagecup",
    "maxcup",
    "minfirmness",
    "averagefirmness",
    "maxfirmness",
    "african",
    "asian",
    "caucasian",
];

/// The phenotypes between races and ages: index, first tag, last tag. Age starts at adulthood.
const AXES: [(usize, usize, usize); 8] = [
    (0, 0, 1),
    (1, 2, 3),
    (2, 4, 6),
    (3, 7, 9),
    (4, 10, 11),
    (5, 12, 13),
    (6, 14, 16),
    (7, 17, 19),
];

/// The first race tag, and the first race phenotype.
const RACE: (usize, usize) = (20, 8);

/// Phenotypes to mode weights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Blend {
    /// The tags (indices into [`TAGS`]) whose weights multiply, for every term.
    pub terms: Vec<Vec<u8>>,
    /// `P`, a row of `terms.len()` for every mode.
    pub projection: Vec<f64>,
    /// What is added to `P c`, one per mode.
    pub bias: Vec<f64>,
}

/// The weight of every tag, and its slope by the phenotype of its axis.
struct Tags {
    weight: [f64; 23],
    slope: [[f64; 11]; 23],
}

impl Blend {
    /// How many modes there are.
    pub fn n_modes(&self) -> usize {
        self.bias.len()
    }

    /// The coefficient `c` of every term.
    pub fn terms_at(&self, phenotypes: &[f64; 11]) -> Vec<f64> {
        let tags = Tags::at(phenotypes);
        self.terms
            .iter()
            .map(|t| t.iter().map(|&i| tags.weight[i as usize]).product())
            .collect()
    }

    /// The weight of every mode at these phenotypes.
    pub fn weights(&self, phenotypes: &[f64; 11]) -> Vec<f64> {
        let c = self.terms_at(phenotypes);
        let dot = |row: &[f64]| row.iter().zip(&c).map(|(p, c)| p * c).sum::<f64>();
        self.projection
            .chunks(c.len().max(1))
            .zip(&self.bias)
            .map(|(row, b)| dot(row) + b)
            .collect()
    }

    /// `∂w/∂phenotype`, a row for every mode; at a kink, the slope on the upper side.
    pub fn slopes(&self, phenotypes: &[f64; 11]) -> Vec<[f64; 11]> {
        let tags = Tags::at(phenotypes);
        let terms: Vec<[f64; 11]> = self.terms.iter().map(|t| tags.product_slope(t)).collect();
        let row = |row: &[f64]| {
            let mut sum = [0.0; 11];
            for (p, t) in row.iter().zip(&terms) {
                for k in 0..11 {
                    sum[k] += p * t[k];
                }
            }
            sum
        };
        self.projection
            .chunks(terms.len().max(1))
            .map(row)
            .collect()
    }
}

impl Tags {
    fn at(phenotypes: &[f64; 11]) -> Self {
        let mut tags = Self {
            weight: [0.0; 23],
            slope: [[0.0; 11]; 23],
        };
        for (axis, first, last) in AXES {
            let start = if axis == crate::shape::AGE {
                ADULT
            } else {
                0.0
            };
            let spans = (last - first) as f64;
            let per = spans / (1.0 - start);
            let at = ((phenotypes[axis] - start) * per).clamp(0.0, spans);
            let low = (at.floor() as usize).min(last - first - 1);
            let t = at - low as f64;
            tags.weight[first + low] = 1.0 - t;
            tags.weight[first + low + 1] = t;
            tags.slope[first + low][axis] = -per;
            tags.slope[first + low + 1][axis] = per;
        }
        tags.races(phenotypes);
        tags
    }

    /// Races count by their share; without any, all alike.
    fn races(&mut self, phenotypes: &[f64; 11]) {
        let (tag, first) = RACE;
        let values = &phenotypes[first..first + 3];
        let sum: f64 = values.iter().sum();
        for i in 0..3 {
            self.weight[tag + i] = if sum > 0.0 {
                values[i] / sum
            } else {
                1.0 / 3.0
            };
            for j in 0..3 {
                let own = f64::from(u8::from(i == j));
                let slope = (own - self.weight[tag + i]) / sum;
                self.slope[tag + i][first + j] = if sum > 0.0 { slope } else { 0.0 };
            }
        }
    }

    fn product_slope(&self, term: &[u8]) -> [f64; 11] {
        let mut sum = [0.0; 11];
        for (n, &tag) in term.iter().enumerate() {
            let others = term.iter().enumerate().filter(|&(m, _)| m != n);
            let rest: f64 = others.map(|(_, &t)| self.weight[t as usize]).product();
            for k in 0..11 {
                sum[k] += rest * self.slope[tag as usize][k];
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    fn blend() -> Blend {
        let tag = |n: &str| TAGS.iter().position(|t| *t == n).expect("a tag") as u8;
        let terms = vec![
            vec![tag("male"), tag("old"), tag("maxmuscle"), tag("minweight")],
            vec![
                tag("female"),
                tag("young"),
                tag("averagemuscle"),
                tag("averageweight"),
            ],
            vec![tag("asian"), tag("female"), tag("young")],
        ];
        Blend {
            terms,
            projection: vec![1.0, 2.0, 3.0, -1.0, 0.5, 0.25],
            bias: vec![0.1, -0.2],
        }
    }

    #[test]
    fn a_corner_has_its_term_alone() {
        let male = [0.0, 1.0, 1.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 1.0];
        assert_eq!(blend().terms_at(&male), vec![1.0, 0.0, 0.0]);
        let female = [1.0, ADULT, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 1.0, 0.0];
        assert_eq!(blend().terms_at(&female), vec![0.0, 1.0, 1.0]);
    }

    #[test]
    fn no_race_at_all_is_all_alike() {
        let mut p = Shape::default().phenotypes;
        p[8..].fill(0.0);
        let none = blend().weights(&p);
        p[8..].fill(0.7);
        let alike = blend().weights(&p);
        assert!(none.iter().zip(&alike).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn slopes_are_those_of_finite_differences() {
        let blend = blend();
        let p = [0.4, 0.81, 0.7, 0.3, 0.2, 0.6, 0.1, 0.9, 0.2, 0.5, 0.7];
        let slopes = blend.slopes(&p);
        for axis in 0..11 {
            let (mut a, mut b) = (p, p);
            a[axis] -= 1e-6;
            b[axis] += 1e-6;
            let (a, b) = (blend.weights(&a), blend.weights(&b));
            for m in 0..2 {
                assert!(
                    ((b[m] - a[m]) / 2e-6 - slopes[m][axis]).abs() < 1e-8,
                    "{m} {axis}"
                );
            }
        }
    }
}
