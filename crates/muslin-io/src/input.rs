//! Opening files: regular ones only, whole, and never beyond a cap.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::error::{self, Fault, IoError, Place};
use crate::sha256::sha256;

/// A file as it was read.
#[derive(Clone, PartialEq, Eq)]
pub struct Input {
    /// The file as the user named it.
    pub file: String,
    /// All its bytes.
    pub bytes: Vec<u8>,
}

impl Input {
    /// SHA-256 of the bytes, in hexadecimal: what a report says about its inputs.
    pub fn sha256(&self) -> String {
        sha256(&self.bytes)
    }
}

/// Reads the regular file at `path`, at most `cap` bytes.
///
/// A folder, pipe, socket or device is refused before it is opened, so that nothing can block
/// or run on for ever. Links are followed. An empty file is invalid.
pub fn read_file(path: &Path, cap: u64) -> Result<Input, IoError> {
    let file = error::name(path);
    let cannot = |e: std::io::Error| error::unreadable(&file, &e);
    regular(&file, &fs::metadata(path).map_err(cannot)?, cap)?;
    let open = File::open(path).map_err(cannot)?;
    let meta = open.metadata().map_err(cannot)?;
    regular(&file, &meta, cap)?;
    let mut bytes = Vec::with_capacity(usize::try_from(meta.len()).unwrap_or(0));
    open.take(cap + 1).read_to_end(&mut bytes).map_err(cannot)?;
    if bytes.len() as u64 > cap {
        return Err(too_large(&file, bytes.len() as u64, cap));
    }
    if bytes.is_empty() {
        let fault = Fault::new("empty-file", file, "the file is empty").at(Place::Byte(0));
        return Err(fault
            .hint("copy it again from where it came from")
            .invalid());
    }
    Ok(Input { file, bytes })
}

/// The files of `folder` whose names end in one of `kinds`, such as `bvh`, in the order of their
/// names; what lies in folders within is left out.
pub fn files_in(folder: &Path, kinds: &[&str]) -> Result<Vec<PathBuf>, IoError> {
    let cannot = |e: std::io::Error| error::unreadable(&error::name(folder), &e);
    let is_wanted = |path: &PathBuf| {
        let kind = path.extension().unwrap_or_default();
        kinds.iter().any(|k| kind.eq_ignore_ascii_case(k)) && path.is_file()
    };
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(cannot)? {
        files.push(entry.map_err(cannot)?.path());
    }
    files.retain(is_wanted);
    files.sort();
    Ok(files)
}

/// Only regular files of at most `cap` bytes pass.
fn regular(file: &str, meta: &fs::Metadata, cap: u64) -> Result<(), IoError> {
    if meta.is_dir() {
        let fault = Fault::new("is-a-folder", file, "this is a folder");
        return Err(fault.hint("name one file in it").disk());
    }
    if !meta.is_file() {
        let fault = Fault::new("not-a-file", file, "this is a pipe, socket or device");
        return Err(fault
            .hint("save the data to a file first and name that")
            .refused());
    }
    if meta.len() > cap {
        Err(too_large(file, meta.len(), cap))
    } else {
        Ok(())
    }
}

fn too_large(file: &str, found: u64, cap: u64) -> IoError {
    Fault::new("file-large", file, "the file is too large")
        .found(mebibytes(found))
        .allowed(mebibytes(cap))
        .hint("make it smaller, or raise the limit if you trust it")
        .refused()
}

/// A size as people read it.
pub fn mebibytes(bytes: u64) -> String {
    match bytes {
        0..1024 => format!("{bytes} bytes"),
        1024..1_048_576 => format!("{:.1} KiB", bytes as f64 / 1024.0),
        _ => format!("{:.1} MiB", bytes as f64 / 1_048_576.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    #[test]
    fn reads_a_file_whole_and_knows_its_hash() {
        let folder = Folder::new("input-whole");
        let path = folder.put("a b ü.txt", b"abc");
        let input = read_file(&path, 3).expect("three bytes are allowed");
        assert_eq!(input.bytes, b"abc");
        assert!(input.sha256().starts_with("ba7816bf8f01cfea"));
    }

    #[test]
    fn a_byte_over_the_cap_is_refused() {
        let folder = Folder::new("input-cap");
        let err = read_file(&folder.put("a", b"abcd"), 3)
            .err()
            .expect("four bytes are not");
        assert_eq!((err.code(), err.exit_code()), ("file-large", 4));
    }

    #[test]
    fn folders_devices_missing_and_empty_files_each_get_their_own_answer() {
        let folder = Folder::new("input-kinds");
        let missing = folder.path().join("nothing");
        let empty = folder.put("empty", b"");
        let cases = [
            (folder.path(), "is-a-folder", 5),
            (missing.as_path(), "cannot-read", 5),
            (empty.as_path(), "empty-file", 3),
            #[cfg(unix)]
            (Path::new("/dev/zero"), "not-a-file", 4),
        ];
        for (path, code, exit) in cases {
            let err = read_file(path, 10)
                .err()
                .expect("none of these is a file to read");
            assert_eq!((err.code(), err.exit_code()), (code, exit), "{err}");
            assert!(!err.hint().is_empty() && err.to_string().contains(&error::name(path)));
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_itself_is_an_error_not_a_hang() {
        let folder = Folder::new("input-loop");
        let link = folder.path().join("loop");
        std::os::unix::fs::symlink(&link, &link).expect("links can be made here");
        assert_eq!(
            read_file(&link, 10)
                .err()
                .expect("a loop has no end")
                .exit_code(),
            5
        );
    }
}
