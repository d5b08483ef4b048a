//! Fabric: what cloth weighs, how it stretches, bends, slides and shines.
//!
//! SI throughout. The presets are choices inside published ranges, each with its source and how
//! far to trust it; the `paper-` ones repeat the tables of two publications for comparison.

mod presets;

use muslin_body::names;

/// One fabric.
#[derive(Clone, Debug, PartialEq)]
pub struct Fabric {
    /// What it is asked for by, as `cotton-jersey`.
    pub name: String,
    /// Mass per area [kg/m²]; 0.15 is 150 g/m².
    pub density: f64,
    /// Thickness under light pressure [m].
    pub thickness: f64,
    /// Force per width per unit strain along the warp [N/m].
    pub stretch_warp: f64,
    /// The same along the weft [N/m].
    pub stretch_weft: f64,
    /// Force per width per radian of shear [N/m].
    pub shear: f64,
    /// Bending stiffness when the warp curves [N m].
    pub bend_warp: f64,
    /// Bending stiffness when the weft curves [N m].
    pub bend_weft: f64,
    /// Coulomb friction against itself and the body [-].
    pub friction: f64,
    /// Strain it does not exceed in wear (0.06 is 6 %); `None` where no figure is known.
    pub strain_limit: Option<f64>,
    /// Where the figures come from, the strain limit's source included.
    pub source: String,
    /// How far to trust them.
    pub confidence: Confidence,
    /// How it looks.
    pub look: Look,
}

/// How far to trust a fabric's figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Confidence {
    /// Measured on one cloth.
    Measured,
    /// Chosen by us inside the range that published measurements span.
    Chosen,
    /// Repeated from a publication for comparison; not the figures of a real cloth.
    Paper,
}

/// How a fabric looks in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Colour, linear RGB, 0 to 1.
    pub colour: [f32; 3],
    /// How the yarns cross.
    pub weave: Weave,
    /// Length after which the weave repeats [m].
    pub repeat: f64,
    /// Strength of the soft glow at grazing angles, 0 to 1.
    pub sheen: f32,
    /// Roughness of the surface, 0 (mirror) to 1.
    pub roughness: f32,
}

/// How the yarns of a fabric cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weave {
    /// Over one, under one.
    Plain,
    /// Diagonal ribs, as denim and suiting.
    Twill,
    /// Long floats, as charmeuse.
    Satin,
    /// Loops in wales, as jersey.
    Knit,
}

/// Why a fabric cannot be had.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FabricError {
    /// No preset has the name.
    #[error("no fabric is called {name:?}; near it: {}", nearest.join(", "))]
    Unknown {
        /// The name asked for.
        name: String,
        /// Names near it, the most alike first.
        nearest: Vec<String>,
    },
    /// A figure that no cloth can have.
    #[error("fabric {fabric:?}: {field} is {value}, it must be {must}")]
    Impossible {
        /// Whose figure.
        fabric: String,
        /// Which figure.
        field: &'static str,
        /// What it is.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
}

/// Membrane stiffness above which a fabric is stiffer than any cloth [N/m].
pub const STIFFEST: f64 = 2e4;
/// Lightest and heaviest mass per area that cloth has [kg/m²].
pub const WEIGHTS: [f64; 2] = [0.03, 0.7];

impl Fabric {
    /// The preset of a name; letter case, spaces and underscores do not matter.
    ///
    /// # Errors
    /// [`FabricError::Unknown`] with the nearest names.
    pub fn named(name: &str) -> Result<Self, FabricError> {
        let asked = name.trim().to_lowercase().replace([' ', '_'], "-");
        let unknown = || FabricError::Unknown {
            name: name.to_owned(),
            nearest: names::nearest(&asked, presets::names())
                .into_iter()
                .take(3)
                .collect(),
        };
        presets::all().find(|f| f.name == asked).ok_or_else(unknown)
    }

    /// Every preset: real fabrics first, then the papers' tables.
    pub fn presets() -> Vec<Self> {
        presets::all().collect()
    }

    /// Peirce's bending length in warp and weft [m]: `∛(B / ρ g)`, half the overhang of a strip whose end hangs at
    /// 41.5 degrees (ASTM D1388).
    pub fn bending_length(&self) -> [f64; 2] {
        [self.bend_warp, self.bend_weft].map(|b| (b / (self.density * 9.81)).cbrt())
    }

    /// The drape coefficient that our solver finds for a preset (BS 5058: a disc of 30 cm over 18 cm), least and most
    /// of three meshes [%]; nothing for any other cloth.
    pub fn drape(&self) -> Option<[f64; 2]> {
        let preset = Self::named(&self.name).ok()?;
        (preset == *self).then(|| presets::drape(&self.name))?
    }

    /// Whether the figures are those of a publication and not of a real cloth.
    pub fn is_paper(&self) -> bool {
        self.confidence == Confidence::Paper
    }

    /// Whether every figure is a number that cloth can have.
    ///
    /// # Errors
    /// [`FabricError::Impossible`] with the first that is not.
    pub fn check(&self) -> Result<(), FabricError> {
        let positive = [
            ("density", self.density),
            ("thickness", self.thickness),
            ("warp stretch", self.stretch_warp),
            ("weft stretch", self.stretch_weft),
            ("shear", self.shear),
            ("warp bending", self.bend_warp),
            ("weft bending", self.bend_weft),
            ("strain limit", self.strain_limit.unwrap_or(1.0)),
        ];
        for (field, value) in positive {
            self.require(
                field,
                value,
                "above zero and finite",
                value > 0.0 && value.is_finite(),
            )?;
        }
        let fits = (0.0..=2.0).contains(&self.friction);
        self.require("friction", self.friction, "between 0 and 2", fits)
    }

    fn require(
        &self,
        field: &'static str,
        value: f64,
        must: &'static str,
        holds: bool,
    ) -> Result<(), FabricError> {
        let fabric = || self.name.clone();
        if holds {
            Ok(())
        } else {
            Err(FabricError::Impossible {
                fabric: fabric(),
                field,
                value,
                must,
            })
        }
    }

    /// What is unlike any real cloth, as sentences for the user; empty as a rule.
    pub fn warnings(&self) -> Vec<String> {
        let mut out = Vec::new();
        let stiffest = self.stretch_warp.max(self.stretch_weft).max(self.shear);
        if stiffest > STIFFEST {
            out.push(format!(
                "fabric {} stretches with {stiffest:.0} N/m, stiffer than cloth (at most {STIFFEST:.0})",
                self.name
            ));
        }
        if !(WEIGHTS[0]..=WEIGHTS[1]).contains(&self.density) {
            out.push(format!(
                "fabric {} weighs {:.0} g/m2, cloth weighs {:.0} to {:.0}",
                self.name,
                self.density * 1e3,
                WEIGHTS[0] * 1e3,
                WEIGHTS[1] * 1e3
            ));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_cloth_and_warn_of_nothing_but_the_papers() {
        for fabric in Fabric::presets() {
            assert_eq!(fabric.check(), Ok(()), "{}", fabric.name);
            assert!(!fabric.source.is_empty());
            if !fabric.is_paper() {
                assert_eq!(fabric.warnings(), Vec::<String>::new());
                assert!(fabric.strain_limit.is_some());
            }
        }
    }

    #[test]
    fn paper_presets_have_no_limit_and_the_fibre_moduli_are_called_out() {
        let papers: Vec<Fabric> = Fabric::presets()
            .into_iter()
            .filter(Fabric::is_paper)
            .collect();
        assert_eq!(papers.len(), 4);
        for fabric in &papers {
            assert!(fabric.name.starts_with("paper-") && fabric.strain_limit.is_none());
        }
        let silk = Fabric::named("paper-vdp-silk").expect("a preset");
        assert!(silk.warnings().iter().any(|w| w.contains("N/m")));
        let cotton = Fabric::named("paper-vdp-cotton").expect("a preset");
        assert_eq!(cotton.warnings().len(), 2, "too stiff and too light");
        assert!(
            Fabric::named("paper-snug-cotton")
                .expect("a preset")
                .warnings()
                .is_empty()
        );
    }

    #[test]
    fn stiffer_and_lighter_cloth_bends_later_and_figures_of_drape_are_of_the_preset_alone() {
        let mut silk = Fabric::named("silk-charmeuse").expect("a preset");
        // 1 µN m and 83 g/m²: ∛(1e-6 / 0.814) m.
        assert!((silk.bending_length()[0] - 0.010_709).abs() < 1e-6);
        assert_eq!(silk.drape(), Some([33.0, 35.3]));
        silk.bend_weft *= 8.0;
        let [warp, weft] = silk.bending_length();
        assert!((weft / warp - 2.0).abs() < 1e-12);
        assert_eq!(silk.drape(), None);
        let paper = Fabric::named("paper-vdp-silk").expect("a preset");
        assert_eq!(paper.drape(), None);
    }

    #[test]
    fn limits_are_those_agreed() {
        let limit = |name| Fabric::named(name).expect("a preset").strain_limit;
        assert_eq!(limit("cotton-shirting"), Some(0.06));
        assert_eq!(limit("cotton-jersey"), Some(0.13));
        assert_eq!(limit("silk-charmeuse"), Some(0.06));
        assert_eq!(limit("wool-suiting"), Some(0.085));
        assert_eq!(limit("denim"), Some(0.03));
        assert_eq!(limit("polyester-lining"), Some(0.06));
        assert_eq!(limit("nylon-taffeta"), Some(0.05));
    }

    #[test]
    fn names_are_forgiving_and_a_slip_offers_the_nearest() {
        assert_eq!(
            Fabric::named("Cotton Jersey").map(|f| f.name),
            Ok("cotton-jersey".into())
        );
        let Err(FabricError::Unknown { nearest, .. }) = Fabric::named("cotton-jersy") else {
            panic!("there is no cotton-jersy");
        };
        assert_eq!(nearest[0], "cotton-jersey");
        let said = Fabric::named("silk")
            .expect_err("no such preset")
            .to_string();
        assert!(said.contains("silk-charmeuse"), "{said}");
    }

    #[test]
    fn names_differ() {
        let mut names: Vec<String> = Fabric::presets().into_iter().map(|f| f.name).collect();
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count);
    }

    #[test]
    fn impossible_figures_are_refused_by_name() {
        let silk = Fabric::named("silk-charmeuse").expect("a preset");
        let none = Fabric {
            density: f64::NAN,
            ..silk.clone()
        };
        assert!(
            none.check()
                .is_err_and(|e| e.to_string().contains("density"))
        );
        let none = Fabric {
            friction: -0.1,
            ..silk.clone()
        };
        assert!(
            none.check()
                .is_err_and(|e| e.to_string().contains("friction"))
        );
        let none = Fabric {
            strain_limit: Some(0.0),
            ..silk
        };
        assert!(
            none.check()
                .is_err_and(|e| e.to_string().contains("strain limit"))
        );
    }

    #[test]
    fn looks_are_colours_and_scales_one_can_see() {
        for fabric in Fabric::presets() {
            let look = fabric.look;
            assert!(
                look.colour.iter().all(|c| (0.0..=1.0).contains(c)),
                "{}",
                fabric.name
            );
            assert!((1e-4..5e-3).contains(&look.repeat), "{}", fabric.name);
            assert!((0.0..=1.0).contains(&look.sheen) && (0.0..=1.0).contains(&look.roughness));
        }
    }
}
