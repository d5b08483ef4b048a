//! What may be asked of `train`.

use std::path::{Path, PathBuf};

use muslin_body::motions;
use muslin_garment::Fabric;
use muslin_model::Precision;
use muslin_train::published::{Course, Isotropic, StretchLaw, System};
use muslin_train::{Place, Plan, has_device};

use crate::failure::{Exit, Failure};
use crate::options::{DressOptions, Wear, within};

/// Options of `train`; the default is what a stranger would want.
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// The published system that is taught; our own if none.
    pub system: Option<System>,
    /// Who wears what: one garment, or several that are worn over each other.
    pub dress: DressOptions,
    /// Built-in motions, files, or folders of files to learn from.
    pub motion: Vec<String>,
    /// Poses of the motions that are learnt from, at most; of a system that learns from poses in time
    /// windows of them.
    pub poses: usize,
    /// Poses mixed of those of the motions, besides them: where recordings are few, these are what
    /// makes a garment know arms that it was not shown. [`TrainOptions::MIXED`] if not said.
    pub mixed: Option<usize>,
    /// Motions that are not learnt from but judged at the end.
    pub check: Vec<String>,
    /// A model of the same garment to begin with; its triangles may be others.
    pub from: Option<PathBuf>,
    /// Edge of the coarser cloth [m] that learns as many steps first, and is then begun with.
    pub coarse: Option<f64>,
    /// Teach any fabric, not only that which is worn.
    pub any_fabric: bool,
    /// Teach any adult body, not only the one that was asked for.
    pub any_shape: bool,
    /// Teach any size, from a little tight to several sizes too large, not only one.
    pub any_size: bool,
    /// Steps of learning.
    pub steps: u64,
    /// Learnt shapes of our own network; 64 if not said.
    pub codes: Option<usize>,
    /// Width of its two inner layers, 128 if not said; of NCS the size of its codes, 512.
    pub width: Option<usize>,
    /// Whether NCS is told turns alone, not the direction of gravity as well.
    pub without_gravity: bool,
    /// Recurrent layers of SNUG; 4 if not said.
    pub layers: Option<usize>,
    /// Poses before a window at most that SNUG's state goes through first; 30 if not said.
    pub warm: Option<usize>,
    /// Share of the samples whose motions NCS exchanges; 0.2 if not said.
    pub augment: Option<f64>,
    /// How the cloth of NCS resists stretch; by yarns and shear if not said.
    pub stretch: Option<StretchLaw>,
    /// How the cloth comes to follow the bones; if not said, our own network learns it on cores where cloth is not let go.
    pub skinning: Option<Skinning>,
    /// Whether PBNS's outer garments do not push those below.
    pub stop_gradient: bool,
    /// How steeply poses that cost much count for less in our own training; 1.5 if not said.
    pub fairness: Option<f64>,
    /// Steps that cloth goes by itself in our own training before it is learnt from; none if not said.
    pub relaxed: Option<usize>,
    /// In what numbers the file has network and shapes; the smallest that change next to nothing if not said.
    pub weights: Option<Precision>,
    /// The terms of the files that are learnt from, as the model is to say them.
    pub terms: Option<String>,
    /// Where random numbers start.
    pub seed: u64,
    /// Step size of the network, if not the usual one.
    pub rate: Option<f64>,
    /// Where the steps of our own training are taken.
    pub device: Place,
    /// Steps from one picture of what has been learnt to the next; no pictures if not said.
    pub picture: Option<u64>,
    /// Go on with an unfinished training.
    pub resume: bool,
}

impl Default for TrainOptions {
    fn default() -> Self {
        let dress = DressOptions {
            outfit: vec![Wear::parse("tee")],
            ..DressOptions::default()
        };
        Self {
            system: None,
            dress,
            motion: motions::NAMES.map(str::to_owned).to_vec(),
            poses: 500,
            mixed: None,
            check: Vec::new(),
            from: None,
            coarse: None,
            any_fabric: false,
            any_shape: false,
            any_size: false,
            steps: Plan::default().steps,
            codes: None,
            width: None,
            without_gravity: false,
            layers: None,
            warm: None,
            augment: None,
            stretch: None,
            skinning: None,
            stop_gradient: false,
            fairness: None,
            relaxed: None,
            weights: None,
            terms: None,
            seed: Plan::default().seed,
            rate: None,
            device: Place::Any,
            picture: None,
            resume: false,
        }
    }
}

/// How cloth comes to follow the bones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Skinning {
    /// As the skin below it does, spread.
    Given,
    /// As training makes of that.
    Learnt,
}

/// The fabric of the published systems, if no other is asked for.
const PAPER_FABRIC: &str = "paper-snug-cotton";
/// Poisson's ratio of what shears most easily: SNUG's own.
const SOFTEST: f64 = 0.485;

impl TrainOptions {
    /// Poses that are mixed if nothing else is said.
    pub const MIXED: usize = 900;

    /// Whether what is taught learns from poses in time.
    pub(super) fn is_moving(&self) -> bool {
        self.system.is_some_and(System::is_moving)
    }

    /// The same in the fabric of the papers, where a published system is taught and no other is asked for.
    pub(super) fn with_fabric(&self, mut warn: impl FnMut(&str)) -> Self {
        let mut options = self.clone();
        let Some(system) = self.system else {
            return options;
        };
        for worn in &mut options.dress.outfit {
            let fabric = &mut worn.fabric;
            let other = fabric.as_ref().filter(|f| *f != PAPER_FABRIC);
            if let Some(asked) = other.filter(|_| system != System::Snug) {
                let name = system.name();
                warn(&format!(
                    "{name} learns with its published constants; {asked} is what --refine solves with"
                ));
            }
            fabric.get_or_insert_with(|| PAPER_FABRIC.to_owned());
        }
        options
    }

    /// Refuses options of another trainer than the one asked for.
    fn belongs(&self) -> Result<(), Failure> {
        let own = self.system.map_or("our own trainer", System::name);
        let is = |system| self.system == Some(system);
        let ours = "our own network";
        let wrong = [
            ("--fabric", self.any_fabric && self.system.is_some(), ours),
            (
                "--shape",
                self.any_shape && is(System::Ncs),
                "our own network, snug and pbns",
            ),
            ("--from", self.from.is_some() && self.system.is_some(), ours),
            (
                "--coarse",
                self.coarse.is_some() && self.system.is_some(),
                ours,
            ),
            (
                "--sizes",
                self.any_size && (is(System::Ncs) || is(System::Snug)),
                "our own network and pbns",
            ),
            (
                "--codes",
                self.codes.is_some() && self.system.is_some(),
                ours,
            ),
            (
                "--width",
                self.width.is_some() && (is(System::Pbns) || is(System::Snug)),
                "our own network and ncs",
            ),
            (
                "--without-gravity",
                self.without_gravity && !is(System::Ncs),
                "ncs",
            ),
            (
                "--layers",
                self.layers.is_some() && !is(System::Snug),
                "snug",
            ),
            ("--warm", self.warm.is_some() && !is(System::Snug), "snug"),
            (
                "--augment",
                self.augment.is_some() && !is(System::Ncs),
                "ncs",
            ),
            (
                "--stretch",
                self.stretch.is_some() && !is(System::Ncs),
                "ncs",
            ),
            (
                "--skinning",
                self.skinning == Some(Skinning::Learnt) && is(System::Snug),
                "our own network, pbns and ncs",
            ),
            (
                "--stop-gradient",
                self.stop_gradient && !is(System::Pbns),
                "pbns",
            ),
            (
                "--weights i8",
                self.weights == Some(Precision::Eight) && self.system.is_some(),
                ours,
            ),
            (
                "--fairness",
                self.fairness.is_some() && self.system.is_some(),
                ours,
            ),
            (
                "--relax",
                self.relaxed.is_some() && self.system.is_some(),
                ours,
            ),
            (
                "--device",
                self.device == Place::Cuda && self.system.is_some(),
                ours,
            ),
            (
                "--mixed",
                self.mixed.is_some() && self.is_moving(),
                "what learns from single poses",
            ),
        ];
        match wrong.into_iter().find(|w| w.1) {
            Some((option, _, whose)) => {
                let what = format!("is for {whose}, and {own} is to be taught");
                let hint = match self.system {
                    Some(_) => "leave it out; published systems are as published".to_owned(),
                    None => format!("leave it out, or name the system: muslin train {whose}"),
                };
                Err(Failure::new(Exit::Usage, "other-trainer", what)
                    .at(option)
                    .hint(hint))
            }
            None => Ok(()),
        }
    }

    /// Refuses a coarse beginning that is none, or one of two.
    fn begins_once(&self) -> Result<(), Failure> {
        let Some(edge) = self.coarse else {
            return Ok(());
        };
        let [asked, own] = [edge, self.dress.edge].map(|e| e * 1000.0);
        within("--coarse", "mm", Some(asked), (5.0, 25.0))?;
        let fault = |what: String| Failure::new(Exit::Usage, "coarse", what).at("--coarse");
        if self.from.is_some() {
            let what = "a training begins with a model or with coarse cloth, not with both";
            return Err(fault(what.into()).hint("leave out --coarse or --from"));
        }
        if asked <= own {
            let what =
                format!("edges of {asked} mm are no coarser than the garment's own, {own} mm");
            return Err(fault(what).hint("take twice as much, as in --coarse 25"));
        }
        Ok(())
    }

    /// What our own network learns shapes alone with, if that is asked for.
    fn with_shapes_alone(&self) -> Option<&'static str> {
        let others = [
            ("--relax", self.relaxed.is_some_and(|k| k > 0)),
            ("--device cuda", self.device == Place::Cuda),
        ];
        others.into_iter().find(|o| o.1).map(|o| o.0)
    }

    /// Refuses skin weights that are to be learnt by what learns shapes alone.
    fn can_learn_skinning(&self) -> Result<(), Failure> {
        let asked = self.skinning == Some(Skinning::Learnt);
        let Some(option) = self.with_shapes_alone().filter(|_| asked) else {
            return Ok(());
        };
        let what = format!("skin weights are not learnt with {option}");
        let fault = Failure::new(Exit::Usage, "skinning", what).at("--skinning learnt");
        Err(fault.hint(format!("leave out --skinning or {option}")))
    }

    /// The same with skin weights as they are going to be: if nothing is said, our own network learns them where it can.
    pub(super) fn with_skinning(&self) -> Self {
        let on_device = || self.device == Place::Any && has_device();
        let usual = match self.system.is_none() && self.with_shapes_alone().is_none() {
            true if !on_device() => Skinning::Learnt,
            _ => Skinning::Given,
        };
        Self {
            skinning: Some(self.skinning.unwrap_or(usual)),
            ..self.clone()
        }
    }

    /// Whether skin weights are learnt, where that is settled ([`Self::with_skinning`]).
    pub(super) fn learns_skinning(&self) -> bool {
        self.skinning == Some(Skinning::Learnt)
    }

    /// Refuses an outfit where one garment alone is taught.
    fn outfit_fits(&self) -> Result<(), Failure> {
        let n = self.dress.outfit.len();
        if n == 1 {
            return Ok(());
        }
        let whose = match self.system {
            Some(s @ (System::Snug | System::Ncs)) => Some(format!("`train {}`", s.name())),
            _ if self.any_fabric => Some("--fabric any".into()),
            _ if self.from.is_some() => Some("--from".into()),
            _ if self.coarse.is_some() => Some("--coarse".into()),
            _ => None,
        };
        let Some(whose) = whose else {
            return Ok(());
        };
        let what = format!("{n} garments at once, where {whose} is for one");
        Err(Failure::new(Exit::Usage, "one-garment", what)
            .at("--garment")
            .hint("train them one by one: `animate` wears one over the other"))
    }

    /// Refuses numbers out of range and what cannot be taught.
    pub fn check(&self, out: &Path) -> Result<(), Failure> {
        self.dress.check()?;
        self.belongs()?;
        if self.any_shape && self.dress.body.is_some() {
            let what = "a character has a shape of its own";
            let fault = Failure::new(Exit::Usage, "own-shape", what).at("--shape");
            return Err(
                fault.hint("leave it out; --fabric any and --sizes any are for characters as well")
            );
        }
        self.begins_once()?;
        self.can_learn_skinning()?;
        within("--steps", "", Some(self.steps as f64), (1.0, 1e7))?;
        within("--codes", "", self.codes.map(|x| x as f64), (2.0, 512.0))?;
        within("--poses", "", Some(self.poses as f64), (1.0, 1e5))?;
        within("--mixed", "", self.mixed.map(|x| x as f64), (0.0, 1e5))?;
        within("--width", "", self.width.map(|x| x as f64), (4.0, 4096.0))?;
        within("--layers", "", self.layers.map(|x| x as f64), (1.0, 16.0))?;
        within("--warm", "", self.warm.map(|x| x as f64), (0.0, 1000.0))?;
        within("--augment", "", self.augment, (0.0, 1.0))?;
        within("--fairness", "", self.fairness, (0.0, 3.0))?;
        within("--relax", "", self.relaxed.map(|x| x as f64), (0.0, 64.0))?;
        within("--rate", "", self.rate, (1e-6, 0.1))?;
        within("--picture", "", self.picture.map(|x| x as f64), (1.0, 1e7))?;
        self.outfit_fits()?;
        if !out
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("muslin"))
        {
            let what = format!("{} is not the name of a .muslin file", out.display());
            return Err(Failure::new(Exit::Usage, "file-kind", what)
                .at("--out")
                .hint("as in -o tee.muslin"));
        }
        Ok(())
    }

    pub(super) fn plan(&self) -> Plan {
        let usual = Plan::default();
        Plan {
            codes: self.codes.unwrap_or(usual.codes),
            hidden: self.width.map_or(usual.hidden, |w| vec![w; 2]),
            steps: self.steps,
            seed: self.seed,
            rate: self.rate.map_or(usual.rate, |r| r as f32),
            fairness: self.fairness.map_or(usual.fairness, |p| p as f32),
            relaxed: self.relaxed.unwrap_or(usual.relaxed),
            skinning: self.learns_skinning(),
            ..usual
        }
    }

    /// The course of a system in `fabric`, which is for SNUG alone.
    pub(super) fn course(&self, system: System, fabric: &Fabric) -> Course {
        let is_own = system == System::Snug && fabric.name != PAPER_FABRIC;
        Course {
            sheet: is_own.then(|| isotropic(fabric)),
            ..self.paper_course(system)
        }
    }

    /// The course of a system in the fabric of its paper.
    pub(super) fn paper_course(&self, system: System) -> Course {
        let usual = Course::of(system);
        Course {
            windows: if self.is_moving() {
                self.poses
            } else {
                usize::MAX
            },
            rate: self.rate.map_or(usual.rate, |r| r as f32),
            layers: self.layers.unwrap_or(usual.layers),
            warm: self.warm.unwrap_or(usual.warm),
            width: self.width.unwrap_or(usual.width),
            gravity: !self.without_gravity,
            augmented: self.augment.unwrap_or(usual.augmented),
            stretch: self.stretch.unwrap_or(usual.stretch),
            skinning: self.learns_skinning(),
            one_way: self.stop_gradient,
            seed: self.seed,
            ..usual
        }
    }
}

/// The sheet most like a fabric that is alike in all directions: its stretch and bending the means of warp and weft,
/// and sheared as easily as such a sheet can be.
fn isotropic(fabric: &Fabric) -> Isotropic {
    let stretch = 0.5 * (fabric.stretch_warp + fabric.stretch_weft);
    Isotropic {
        stretch,
        poisson: (0.5 * stretch / fabric.shear - 1.0).clamp(0.0, SOFTEST),
        bend: 0.5 * (fabric.bend_warp + fabric.bend_weft),
        density: fabric.density,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn snug_is_taught_in_a_fabric_as_its_paper_would_state_it() {
        let snug = |name: &str| {
            let fabric = Fabric::named(name).expect("a preset");
            let options = TrainOptions::default();
            options.course(System::Snug, &fabric).sheet
        };
        assert_eq!(snug(PAPER_FABRIC), None);
        // Virtual Draping, table 1: 14 GPa, 0.475, 60 µm, 510 kg/m³.
        let silk = snug("paper-vdp-silk").expect("another cloth");
        let bend = 14e9 * 60e-6_f64.powi(3) / (12.0 * (1.0 - 0.475_f64.powi(2)));
        let want = [14e9 * 60e-6, 0.475, bend, 510.0 * 60e-6];
        let got = [silk.stretch, silk.poisson, silk.bend, silk.density];
        for (got, want) in got.iter().zip(want) {
            assert!((got / want - 1.0).abs() < 0.02, "{got} {want}");
        }
        // Cloth that shears more easily than any such sheet.
        let charmeuse = snug("silk-charmeuse").expect("another cloth");
        assert_eq!((charmeuse.stretch, charmeuse.poisson), (900.0, SOFTEST));
        let fabric = Fabric::named("silk-charmeuse").expect("a preset");
        let others = [System::Pbns, System::Ncs];
        let taught = others.map(|s| TrainOptions::default().course(s, &fabric).sheet);
        assert_eq!(taught, [None; 2]);
    }

    #[test]
    fn published_systems_wear_the_fabric_of_the_papers_and_say_what_another_is_for() {
        let mut options = TrainOptions::default();
        let worn = |o: &TrainOptions| {
            let mut said = Vec::new();
            let with = o.with_fabric(|w| said.push(w.to_owned()));
            (with.dress.outfit[0].fabric.clone(), said)
        };
        assert_eq!(worn(&options), (None, Vec::new()));
        options.system = Some(System::Snug);
        assert_eq!(worn(&options), (Some(PAPER_FABRIC.into()), Vec::new()));
        options.dress.outfit[0].fabric = Some("denim".into());
        assert_eq!(worn(&options), (Some("denim".into()), Vec::new()));
        options.system = Some(System::Ncs);
        let (fabric, said) = worn(&options);
        assert_eq!(fabric.as_deref(), Some("denim"));
        assert!(
            said.len() == 1 && said[0].contains("published constants"),
            "{said:?}"
        );
    }

    #[test]
    fn windows_are_counted_where_poses_are_learnt_from_in_time() {
        let mut options = TrainOptions {
            poses: 40,
            layers: Some(5),
            ..TrainOptions::default()
        };
        for (system, windows) in [(System::Pbns, usize::MAX), (System::Snug, 40)] {
            options.system = Some(system);
            let cotton = Fabric::named(PAPER_FABRIC).expect("a preset");
            let course = options.course(system, &cotton);
            assert_eq!((course.windows, course.layers), (windows, 5));
        }
    }
}
