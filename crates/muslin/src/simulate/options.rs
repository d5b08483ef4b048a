//! What may be asked of `simulate`.

use std::path::{Path, PathBuf};

use muslin_sim::Air;

use crate::failure::{Exit, Failure};
use crate::options::{DressOptions, Wear, within};

use super::Bake;

/// Options of `simulate`; the default is what a stranger would want.
#[derive(Clone, Debug)]
pub struct SimulateOptions {
    /// Who wears what; what concerns photos is not used.
    pub dress: DressOptions,
    /// A built-in motion, an animation of the character, or a file: BVH, glTF or VRM (`FILE#NAME`), or NPZ with poses.
    pub motion: String,
    /// Frames per second, 12 to 240.
    pub fps: f64,
    /// How much of the motion [s]; all of it if not given.
    pub seconds: Option<f64>,
    /// Where in the motion to start [s].
    pub start: f64,
    /// Whether time goes on by BDF2 instead of implicit Euler: more of a swing is kept.
    pub bdf2: bool,
    /// Density of the air [kg/m³]; 0 for none.
    pub air: f64,
    /// How the air moves, in the animation's axes, Y up [m/s].
    pub wind: [f64; 3],
    /// Go on with an unfinished simulation.
    pub resume: bool,
    /// How garments are written in the animation.
    pub bake: Bake,
    /// Also draw the last frame and a moving picture.
    pub picture: bool,
    /// Let the moving picture's camera go around the body once.
    pub turn: bool,
    /// Also write NPZ in the exchange layout, with this name.
    pub npz: Option<PathBuf>,
    /// Also write point caches, into this folder.
    pub pc2: Option<PathBuf>,
}

/// What may be asked of the air [kg/m³, m/s]: as far as a hundred times its density, and a hurricane.
const DENSEST: f64 = 120.0;
const STORM: f64 = 60.0;

impl Default for SimulateOptions {
    fn default() -> Self {
        let dress = DressOptions {
            outfit: vec![Wear::parse("tee")],
            ..DressOptions::default()
        };
        Self {
            dress,
            motion: "walk".into(),
            fps: 60.0,
            seconds: None,
            start: 0.0,
            bdf2: false,
            air: Air::STILL.density,
            wind: [0.0; 3],
            resume: false,
            bake: Bake::Frames,
            picture: false,
            turn: false,
            npz: None,
            pc2: None,
        }
    }
}

impl SimulateOptions {
    /// Refuses numbers out of range and files of kinds that are not written.
    pub fn check(&self, out: &Path) -> Result<(), Failure> {
        self.dress.check()?;
        within("--fps", "1/s", Some(self.fps), (12.0, 240.0))?;
        within("--seconds", "s", self.seconds, (1.0 / self.fps, 3600.0))?;
        within("--start", "s", Some(self.start), (0.0, 36_000.0))?;
        within("--air", "kg/m³", Some(self.air), (0.0, DENSEST))?;
        for speed in self.wind {
            within("--wind", "m/s", Some(speed), (-STORM, STORM))?;
        }
        kind("--out", out, "glb")?;
        self.npz
            .as_deref()
            .map_or(Ok(()), |p| kind("--npz", p, "npz"))
    }
}

fn kind(option: &str, path: &Path, wanted: &str) -> Result<(), Failure> {
    let is_wanted = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case(wanted));
    if is_wanted && !path.is_dir() {
        return Ok(());
    }
    let what = format!("{} is not the name of a .{wanted} file", path.display());
    let fault = Failure::new(Exit::Usage, "file-kind", what).at(option);
    Err(fault
        .hint("write walk.glb with -o, arrays with --npz FILE.npz, point caches with --pc2 DIR"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_glb_is_written_under_the_main_name() {
        let options = SimulateOptions::default();
        assert!(options.check(Path::new("a/walk.GLB")).is_ok());
        for bad in ["walk.fbx", "walk", ""] {
            let fault = options.check(Path::new(bad)).expect_err("another kind");
            assert_eq!((fault.exit, fault.place.as_str()), (Exit::Usage, "--out"));
        }
    }

    #[test]
    fn rates_and_lengths_out_of_range_are_refused() {
        let check = |o: SimulateOptions| o.check(Path::new("a.glb")).map_err(|f| f.place);
        let of = SimulateOptions::default;
        assert_eq!(
            check(SimulateOptions { fps: 0.0, ..of() }),
            Err("--fps".into())
        );
        assert_eq!(
            check(SimulateOptions {
                seconds: Some(0.0),
                ..of()
            }),
            Err("--seconds".into())
        );
        assert_eq!(
            check(SimulateOptions {
                start: -1.0,
                ..of()
            }),
            Err("--start".into())
        );
        let gale = |wind| check(SimulateOptions { wind, ..of() });
        assert_eq!(gale([0.0, 0.0, -20.0]), Ok(()));
        assert_eq!(gale([0.0, f64::NAN, 0.0]), Err("--wind".into()));
        assert_eq!(gale([90.0, 0.0, 0.0]), Err("--wind".into()));
        assert_eq!(
            check(SimulateOptions { air: -1.0, ..of() }),
            Err("--air".into())
        );
        assert_eq!(
            check(SimulateOptions {
                start: f64::NAN,
                ..of()
            }),
            Err("--start".into())
        );
    }
}
