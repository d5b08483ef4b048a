//! What the published systems are made of and taught by: every constant, in one table.
//!
//! | | PBNS | SNUG | NCS |
//! |---|---|---|---|
//! | paper | Bertiche et al. 2021 | Santesteban et al. 2022 | Bertiche et al. 2022 |
//! | code | hbertiche/PBNS 39d84df | isantesteban/snug a99f742, Simonhfls/GAPS 152d3ab | hbertiche/NeuralClothSim 237eb2c |
//!
//! SNUG's trainer was never released: its network, losses and constants are those of the paper, of
//! its repository and of the reimplementation in GAPS. `docs/models.md` says where we leave them.

/// A published system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum System {
    /// Physically Based Neural Simulator: pose in, cloth at rest out.
    Pbns,
    /// Self-Supervised Neural Dynamic Garments: recurrent, over a window of three poses.
    Snug,
    /// Neural Cloth Simulation: a still and a moving code, over half a second.
    Ncs,
}

impl System {
    /// Its short stable name.
    pub fn name(self) -> &'static str {
        self.recipe().name
    }

    /// Whether it learns from poses in time.
    pub fn is_moving(self) -> bool {
        self.recipe().has_inertia
    }

    /// Rounds in which the skin weights of a garment spread before it learns ([`crate::diffused`]).
    pub fn smoothed(self) -> usize {
        self.recipe().smoothed
    }

    /// Its constants.
    pub(crate) fn recipe(self) -> &'static Recipe {
        match self {
            Self::Pbns => &PBNS,
            Self::Snug => &SNUG,
            Self::Ncs => &NCS,
        }
    }
}

/// A sheet that is alike in all directions, in whose constants SNUG can be taught.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Isotropic {
    /// Young's modulus times thickness [N/m].
    pub stretch: f64,
    /// Poisson's ratio, below 1.
    pub poisson: f64,
    /// Bending stiffness [N m].
    pub bend: f64,
    /// Mass per area [kg/m²].
    pub density: f64,
}

/// What NCS may be taught to resist stretch by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StretchLaw {
    /// Springs along edges.
    MassSpring,
    /// Saint Venant and Kirchhoff's.
    StVk,
    /// Baraff and Witkin's, of yarns and shear: that of its sample configuration.
    BaraffWitkin,
}

impl StretchLaw {
    /// With the constants of the published configuration.
    fn stretch(self) -> Stretch {
        match self {
            Self::MassSpring => Stretch::Edges(10.0),
            Self::StVk => Stretch::StVk(11.1, 20.9),
            Self::BaraffWitkin => Stretch::Yarns(10.0, 1.0),
        }
    }
}

impl Recipe {
    /// The same, where cloth resists stretch by another law.
    pub(crate) fn by(self, law: StretchLaw) -> Self {
        Self {
            stretch: law.stretch(),
            ..self
        }
    }

    /// The same, where cloth stretches, bends and weighs as `sheet` does.
    pub(crate) fn of_sheet(self, sheet: &Isotropic) -> Self {
        let (k, nu) = (sheet.stretch, sheet.poisson);
        let (mu, lambda) = (k / (2.0 * (1.0 + nu)), k * nu / (1.0 - nu * nu));
        Self {
            stretch: Stretch::StVk(mu as f32, lambda as f32),
            bend: Bend::Angles {
                // The law has an eighth where that of a plate has a half.
                stiffness: (4.0 * sheet.bend) as f32,
                is_flat: true,
            },
            density: sheet.density as f32,
            ..self
        }
    }
}

/// What a system is taught by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Recipe {
    pub name: &'static str,
    pub stretch: Stretch,
    pub bend: Bend,
    /// Mass of cloth [kg/m²].
    pub density: f32,
    /// Whether every vertex weighs the same, whatever cloth it stands for.
    pub even_mass: bool,
    pub touch: Touch,
    /// `k` of `k Σ |D|²` on pinned vertices [N/m].
    pub pin: f32,
    pub has_inertia: bool,
    /// Poses at the end of a window that are decoded.
    pub decoded: usize,
    /// How many of them the still laws judge, counted from the end.
    pub judged: usize,
    /// Whether there is a learnt shape that counts alike in every pose.
    pub has_constant: bool,
    /// Rounds in which skin weights spread.
    pub smoothed: usize,
}

/// What it costs to stretch cloth.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Stretch {
    /// `k Σ (l − l̄)²` over edges: `k` [N/m].
    Edges(f32),
    /// Saint Venant and Kirchhoff's law: `μ` and `λ`, times the thickness [N/m].
    StVk(f32, f32),
    /// Baraff and Witkin's: `A (k (|w_u|−1)² + k (|w_v|−1)² + s (w_u · w_v)²)` [N/m].
    Yarns(f32, f32),
}

/// What it costs to fold cloth.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Bend {
    /// `k Σ |n₀ − n₁|²` over inner edges [J].
    Normals(f32),
    /// `k l²/(8 (A₀ + A₁)) (θ − θ̄)²` with a signed angle: `k` [N m], and whether cloth is flat at
    /// rest (`θ̄ = 0`) or as it lies around the body.
    Angles { stiffness: f32, is_flat: bool },
}

/// What it costs to come too near to the skin: `k Σ max(gap − d, 0)ᵖ`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touch {
    /// Distance at which it begins [m].
    pub gap: f32,
    /// `k` [J/mᵖ].
    pub stiffness: f32,
    /// `p`: 2 or 3.
    pub power: i32,
}

/// PBNS: `losses.py`, `config` and the model of the repository.
const PBNS: Recipe = Recipe {
    name: "pbns",
    stretch: Stretch::Edges(15.0),
    bend: Bend::Normals(5e-5),
    density: 0.3,
    even_mass: true,
    touch: Touch {
        gap: 4e-3,
        stiffness: 25.0,
        power: 2,
    },
    pin: 10.0,
    has_inertia: false,
    decoded: 1,
    judged: 1,
    has_constant: false,
    smoothed: 0,
};

/// PBNS's resizer: stretch and bending are its own, the rest is PBNS's.
pub(crate) const RESIZER: Recipe = Recipe {
    stretch: Stretch::Edges(5.0),
    bend: Bend::Normals(1e-5),
    ..PBNS
};

/// Step size, on the sum over a batch, and momentum of the resizer's training.
pub(crate) const RESIZING: [f32; 2] = [1e-5, 0.9];

/// SNUG: E 0.7e5 Pa, ν 0.485, 0.47 mm, 426 kg/m³; bending E t³/(12 (1 − ν²)) times the 50 of its
/// material file; collision by the paper. It pins nothing.
const SNUG: Recipe = Recipe {
    name: "snug",
    // μ = E/(2 (1 + ν)) and λ = E ν/(1 − ν²), times 0.47 mm.
    stretch: Stretch::StVk(11.077, 20.864),
    bend: Bend::Angles {
        stiffness: 3.96e-5,
        is_flat: true,
    },
    density: 0.200_22,
    even_mass: false,
    touch: Touch {
        gap: 2e-3,
        stiffness: 250.0,
        power: 3,
    },
    pin: 0.0,
    has_inertia: true,
    decoded: 3,
    judged: 3,
    has_constant: true,
    smoothed: 0,
};

/// NCS: its sample configuration.
const NCS: Recipe = Recipe {
    name: "ncs",
    stretch: Stretch::Yarns(10.0, 1.0),
    bend: Bend::Angles {
        stiffness: 2e-5,
        is_flat: false,
    },
    density: 0.15,
    even_mass: false,
    touch: Touch {
        gap: 4e-3,
        stiffness: 10.0,
        power: 2,
    },
    pin: 100.0,
    has_inertia: true,
    decoded: 3,
    judged: 1,
    has_constant: false,
    smoothed: 10,
};

/// Sizes of the networks.
pub(crate) mod sizes {
    /// PBNS: all four layers.
    pub const PBNS: [usize; 4] = [32; 4];
    /// PBNS's resizer: all four layers.
    pub const RESIZER: [usize; 4] = [32; 4];
    /// SNUG: each recurrent layer.
    pub const SNUG: usize = 256;
    /// NCS: the still encoder, one joint, all joints, the decoder.
    /// [`NCS_CODE`] stands for what is left out at the ends.
    pub const NCS_STILL: [usize; 3] = [64, 128, 256];
    pub const NCS_JOINT: [usize; 2] = [32; 2];
    pub const NCS_WHOLE: usize = 2;
    pub const NCS_DECODER: usize = 3;
    /// NCS: size of the codes and of all layers around them.
    pub const NCS_CODE: usize = 512;
    /// NCS: deviation of the first weights.
    pub const NCS_START: f64 = 0.05;
    /// SNUG: deviation of the state that a window starts from.
    pub const SNUG_STATE: f64 = 0.1;
    /// SNUG: poses before a window at most that its state goes through first.
    pub const SNUG_WARM: usize = 30;
}

/// Seconds that NCS remembers, and poses beyond that: two are lost to rates, three are decoded.
pub(crate) const NCS_WINDOW: (f64, usize) = (0.5, 3);
