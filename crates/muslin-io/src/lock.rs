//! One job at a time for a result: `NAME.lock` beside it, for as long as the job lives.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};

use crate::error::{Fault, IoError, name};
use crate::output::unwritable;

/// A result that is being made; free again, and its lock gone, when this is dropped. A killed job holds nothing.
#[derive(Debug)]
pub struct Lock {
    path: PathBuf,
    _file: File,
}

impl Lock {
    /// Takes `out` for this job, where its folder is there already.
    ///
    /// Fails where another job makes it.
    pub fn hold(out: &Path) -> Result<Option<Self>, IoError> {
        let mut path = out.as_os_str().to_owned();
        path.push(".lock");
        let path = PathBuf::from(path);
        let folder = path.parent().filter(|f| !f.as_os_str().is_empty());
        if folder.is_some_and(|f| !f.is_dir()) {
            return Ok(None);
        }
        loop {
            let file = OpenOptions::new().create(true).append(true).open(&path);
            let file = file.map_err(|e| unwritable(&path, 0, &e))?;
            take(&file, out)?;
            // Whoever had it may have taken the file away between opening and locking: another would make a new one.
            if is_at(&file, &path) {
                return Ok(Some(Self { path, _file: file }));
            }
        }
    }
}

/// Whether an open file is the one that is called so.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(own), Ok(there)) => (own.dev(), own.ino()) == (there.dev(), there.ino()),
        _ => false,
    }
}

/// Files that are open keep their names here.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}

/// Takes an open file for this job, as long as it stays open; `named` is what is told of where another job has it. Where
/// a disk knows no locks, jobs must keep apart by themselves.
pub(crate) fn take(file: &File, named: &Path) -> Result<(), IoError> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            let fault = Fault::new("busy", name(named), "another job is writing it");
            Err(fault
                .hint("wait for that job, or name another --out")
                .busy())
        }
        _ => Ok(()),
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // That it stays behind hurts nobody: it is the lock that counts, not the file.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_is_made_by_one_job_at_a_time() {
        let folder = std::env::temp_dir().join(format!("muslin-lock-{}", std::process::id()));
        assert!(
            Lock::hold(&folder.join("tee.muslin"))
                .expect("no folder yet")
                .is_none()
        );
        fs::create_dir_all(&folder).expect("a temporary folder");
        let out = folder.join("tee.muslin");
        let held = Lock::hold(&out).expect("free");
        let fault = Lock::hold(&out).expect_err("another job makes it");
        assert_eq!((fault.code(), fault.exit_code()), ("busy", 8), "{fault}");
        // As if it were taken away just before it is locked: this is nobody's any more.
        let lock = folder.join("tee.muslin.lock");
        let gone = File::open(&lock).expect("it is there");
        assert!(is_at(&gone, &lock));
        drop(held);
        #[cfg(unix)]
        assert!(!is_at(&gone, &lock));
        assert!(fs::read_dir(&folder).expect("a folder").next().is_none());
        assert!(Lock::hold(&out).expect("free again").is_some());
        fs::remove_dir_all(&folder).expect("removable");
    }
}
