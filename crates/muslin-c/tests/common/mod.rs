//! A character for tests: our body in a file.

use std::path::PathBuf;

use muslin::{DressOptions, SimulateOptions, Watch, Wear, simulate};

/// Its file, which goes with it.
pub struct Hero {
    pub file: PathBuf,
    folder: PathBuf,
}

impl Hero {
    /// In a folder of that name.
    pub fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("muslin-c-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let file = folder.join("hero.glb");
        let dress = DressOptions {
            outfit: vec![Wear::parse("tee")],
            edge: 0.025,
            ..DressOptions::default()
        };
        let options = SimulateOptions {
            dress,
            motion: "wave".into(),
            fps: 30.0,
            seconds: Some(0.1),
            ..SimulateOptions::default()
        };
        simulate(&file, &options, &mut Watch::nobody()).expect("a body in a file");
        Self { file, folder }
    }

    /// The wardrobe's tee on it.
    pub fn options(&self) -> DressOptions {
        DressOptions {
            outfit: vec![Wear::parse("tee")],
            body: Some(self.file.clone()),
            ..DressOptions::default()
        }
    }
}

impl Drop for Hero {
    fn drop(&mut self) {
        // What cannot be removed is in nobody's way.
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
