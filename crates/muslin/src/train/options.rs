//! What may be asked of `train`.

use std::path::Path;

use muslin_body::motions;
use muslin_train::Plan;

use crate::failure::{Exit, Failure};
use crate::options::{DressOptions, Wear, within};

/// Options of `train`; the default is what a stranger would want.
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Who wears what: one garment.
    pub dress: DressOptions,
    /// Built-in motions, files, or folders of files to learn from.
    pub motion: Vec<String>,
    /// Poses of the motions that are learnt from, at most.
    pub poses: usize,
    /// Poses mixed of those of the motions, besides them: where recordings are few, these are what
    /// makes a garment know arms that it was not shown.
    pub mixed: usize,
    /// Motions that are not learnt from but judged at the end.
    pub check: Vec<String>,
    /// Steps of learning.
    pub steps: u64,
    /// Learnt shapes.
    pub codes: usize,
    /// Width of the network's two inner layers.
    pub width: usize,
    /// Where random numbers start.
    pub seed: u64,
    /// Step size of the network, if not the usual one.
    pub rate: Option<f64>,
    /// Go on with an unfinished training.
    pub resume: bool,
}

impl Default for TrainOptions {
    fn default() -> Self {
        let dress = DressOptions {
            outfit: vec![Wear::parse("tee")],
            ..DressOptions::default()
        };
        let plan = Plan::default();
        Self {
            dress,
            motion: motions::NAMES.map(str::to_owned).to_vec(),
            poses: 500,
            mixed: 900,
            check: Vec::new(),
            steps: plan.steps,
            codes: plan.codes,
            width: plan.hidden[0],
            seed: plan.seed,
            rate: None,
            resume: false,
        }
    }
}

impl TrainOptions {
    /// Refuses numbers out of range and what cannot be taught.
    pub fn check(&self, out: &Path) -> Result<(), Failure> {
        self.dress.check()?;
        within("--steps", "", Some(self.steps as f64), (1.0, 1e7))?;
        within("--codes", "", Some(self.codes as f64), (2.0, 512.0))?;
        within("--poses", "", Some(self.poses as f64), (1.0, 1e5))?;
        within("--mixed", "", Some(self.mixed as f64), (0.0, 1e5))?;
        within("--width", "", Some(self.width as f64), (4.0, 4096.0))?;
        within("--rate", "", self.rate, (1e-6, 0.1))?;
        if self.dress.outfit.len() != 1 {
            let what = format!(
                "{} garments at once cannot be taught yet",
                self.dress.outfit.len()
            );
            return Err(Failure::new(Exit::Usage, "one-garment", what)
                .at("--garment")
                .hint("train them one by one"));
        }
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
            codes: self.codes,
            hidden: vec![self.width; 2],
            steps: self.steps,
            seed: self.seed,
            rate: self.rate.map_or(usual.rate, |r| r as f32),
            ..usual
        }
    }
}
