//! What the tests of this crate share: folders that vanish.

use std::fs;
use std::path::{Path, PathBuf};

/// A folder of its own for one test, removed with everything in it at the end.
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder; `name` must be the test's own.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("muslin-io-{}-{name}", std::process::id()));
        fs::create_dir_all(&path).expect("the system has a folder for temporary files");
        Self(path)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Puts a file into it.
    pub fn put(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.join(name);
        fs::write(&path, bytes).expect("a test's own folder can be written");
        path
    }

    /// Names of everything in it, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("a test's own folder can be listed");
        let name = |e: fs::DirEntry| e.file_name().to_string_lossy().into_owned();
        let mut names: Vec<String> = entries.flatten().map(name).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}
