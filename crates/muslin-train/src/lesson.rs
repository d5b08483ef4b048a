//! What is to be learnt, and how.

use glam::DVec3;
use muslin_body::{Avatar, Figure, Sparse};
use muslin_sim::Cloth;

/// What is to be learnt: a cloth on a body.
#[derive(Clone, Copy)]
pub struct Lesson<'a> {
    /// The body's family.
    pub avatar: &'a Avatar,
    /// The body.
    pub figure: &'a Figure,
    /// What is worn.
    pub cloth: &'a Cloth,
    /// Where it lies around the body at rest [m].
    pub template: &'a [DVec3],
    /// Vertex → (bone of the rig, weight); see [`crate::diffused`].
    pub weights: &'a Sparse,
    /// What our own network is told of wearer and cloth, by name.
    pub traits: &'a [(&'static str, f64)],
}

impl Lesson<'_> {
    /// The template in single precision.
    pub(crate) fn laid(&self) -> Vec<[f32; 3]> {
        let single = |p: &DVec3| p.as_vec3().to_array();
        self.template.iter().map(single).collect()
    }
}

/// How it is learnt. The defaults suit a garment of a few thousand vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Learnt shapes, the constant one included.
    pub codes: usize,
    /// Widths of the network's inner layers.
    pub hidden: Vec<usize>,
    /// Steps in all; the last part of them is slower and slower.
    pub steps: u64,
    /// Packs of sixteen poses in a step.
    pub packs: usize,
    /// Step size of the network.
    pub rate: f32,
    /// Step size of the learnt shapes; one is Newton's.
    pub shape_rate: f32,
    /// Share of the last gradients that a step of the shapes remembers.
    pub momentum: f32,
    /// What is added to the stiffness that shapes are stepped by [N/m].
    pub damping: f64,
    /// Distance at which skin begins to push cloth [m]; the solver's own, so that both come to rest at
    /// the same place.
    pub gap: f64,
    /// Largest stiffness of skin [N/m] per vertex: half of the solver's. Walls push one way, so that the firmer they are,
    /// the farther what is predicted inexactly stays off them.
    pub skin: f64,
    /// Cloth that is stiffer in its plane than this [N/m] is taught as if it were this stiff. Either
    /// hardly stretches under its weight; but what a network leaves of stretch would otherwise cost so much
    /// that nothing else is learnt.
    pub stiffest: f64,
    /// Cloth that is softer in its plane than this [N/m] is at first taught as if it were this stiff and becomes
    /// itself by and by: soft cloth crumples through itself before the network knows where it hangs. A training
    /// that begins with a model has that behind it.
    pub firm: f64,
    /// Cost of stretch and contact [J] beyond which a pose counts for less and less: its weight is this over its
    /// cost, to the power of `fairness`. Cloth that is predicted badly hangs too high, in all poses alike: what a few impossible
    /// poses ask for would lift it in those that are easy.
    pub fair: f64,
    /// How steeply it counts for less. At 1 all poses beyond `fair` weigh alike in what is learnt, whatever they cost; soft
    /// cloth ends better with more, stiff cloth with less.
    pub fairness: f32,
    /// How much is added at random to what the network is told of a pose, in every step anew, as a share of how much
    /// that differs from pose to pose: poses that are nearer to each other than this are to give much the same cloth,
    /// also where none was taught.
    pub blur: f32,
    /// Steps that cloth goes by itself after every prediction before it is learnt from, as a solver's first steps would lead
    /// it: what these mend counts less, so that what is learnt is where refined cloth comes to lie. On cores alone.
    pub relaxed: usize,
    /// Whether skin weights are learnt as well, of the bones that move a vertex at first. On cores alone.
    pub skinning: bool,
    /// Where random numbers start.
    pub seed: u64,
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            codes: 64,
            hidden: vec![128, 128],
            steps: 1500,
            packs: 2,
            rate: 3e-3,
            shape_rate: 0.1,
            momentum: 0.8,
            damping: 0.03,
            gap: 3e-3,
            skin: 200.0,
            stiffest: 1000.0,
            firm: 1000.0,
            fair: 0.01,
            fairness: 1.5,
            blur: 0.05,
            relaxed: 0,
            skinning: false,
            seed: 1,
        }
    }
}
