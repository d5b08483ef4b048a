//! Files out: all of a job's files appear whole, or none does.
//!
//! Every file is first written beside its place under another name and forced to the disk
//! (`fsync`); [`Output::commit`] then renames them all and forces the folder. Whoever looks at a
//! final name sees the old file or the new one, never a part, even after a power cut.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::error::{self, Fault, IoError};
use crate::input::mebibytes;

/// A file that [`Output::commit`] put in its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// Where it is.
    pub path: PathBuf,
    /// Its size [bytes].
    pub bytes: u64,
}

/// How many outputs this process has opened.
static OPENED: AtomicUsize = AtomicUsize::new(0);

/// A folder being filled; dropped before [`commit`](Self::commit), it leaves nothing behind.
pub struct Output {
    folder: PathBuf,
    /// Folders made for this output, outermost first.
    made: Vec<PathBuf>,
    pending: Vec<Pending>,
    create: fn(&Path) -> io::Result<File>,
    /// Tells this output from others of the same process.
    number: usize,
}

/// A file that is whole on the disk but not yet under its name.
struct Pending {
    temp: PathBuf,
    target: PathBuf,
    /// A second name of the file that stood at the target, to undo a half-done commit.
    kept: Option<PathBuf>,
    is_placed: bool,
    bytes: u64,
}

impl Output {
    /// Makes `folder` if need be and checks that files can be written in it.
    pub fn open(folder: &Path) -> Result<Self, IoError> {
        let folder = if folder.as_os_str().is_empty() {
            Path::new(".")
        } else {
            folder
        };
        let made = missing(folder);
        let output = Self {
            folder: folder.into(),
            made,
            pending: Vec::new(),
            create,
            number: OPENED.fetch_add(1, Ordering::Relaxed),
        };
        fs::create_dir_all(folder).map_err(|e| unwritable(folder, 0, &e))?;
        let probe = output.temp("probe");
        create(&probe).map_err(|e| unwritable(folder, 0, &e))?;
        fs::remove_file(&probe).map_err(|e| unwritable(folder, 0, &e))?;
        Ok(output)
    }

    /// Writes a file that will be called `name`; a second one of that name replaces the first.
    ///
    /// `name` is one plain file name: separators, `..` and the like are refused.
    pub fn add(&mut self, name: &str, bytes: &[u8]) -> Result<(), IoError> {
        let target = self.folder.join(writable(name)?);
        if fs::symlink_metadata(&target).is_ok_and(|m| !m.is_file() && !m.is_symlink()) {
            let fault = Fault::new(
                "cannot-write",
                error::name(&target),
                "not a file to replace",
            );
            return Err(fault.hint("remove it or write somewhere else").disk());
        }
        self.forget(&target);
        let temp = self.temp(&format!("{name}.{}", self.pending.len()));
        let size = bytes.len() as u64;
        let file = (self.create)(&temp).map_err(|e| unwritable(&target, size, &e))?;
        // From here on the file is ours to remove, whether or not it can be filled.
        self.pending.push(Pending {
            temp,
            target: target.clone(),
            kept: None,
            is_placed: false,
            bytes: size,
        });
        fill(file, bytes).map_err(|e| unwritable(&target, size, &e))
    }

    /// Gives every file its name. After an error all names hold what they held before.
    pub fn commit(mut self) -> Result<Vec<Written>, IoError> {
        for i in 0..self.pending.len() {
            self.place(i)?;
        }
        sync(&self.folder).map_err(|e| unwritable(&self.folder, 0, &e))?;
        self.made.clear();
        let written = self.pending.drain(..).map(|p| {
            p.kept.iter().for_each(|kept| drop(fs::remove_file(kept)));
            Written {
                path: p.target,
                bytes: p.bytes,
            }
        });
        Ok(written.collect())
    }

    /// Gives the file `i` its name, keeping what stood there under another one.
    fn place(&mut self, i: usize) -> Result<(), IoError> {
        let kept = self.temp(&format!("old.{i}"));
        let file = &mut self.pending[i];
        // Where the file system knows no second names, the old file cannot be brought back.
        file.kept = fs::hard_link(&file.target, &kept).is_ok().then_some(kept);
        let placed = fs::rename(&file.temp, &file.target);
        placed.map_err(|e| unwritable(&file.target, file.bytes, &e))?;
        file.is_placed = true;
        Ok(())
    }

    /// Drops what was added for `target`.
    fn forget(&mut self, target: &Path) {
        if let Some(i) = self.pending.iter().position(|p| p.target == target) {
            let _ = fs::remove_file(self.pending.remove(i).temp);
        }
    }

    /// A name that no other file in the folder has.
    fn temp(&self, name: &str) -> PathBuf {
        let (process, number) = (std::process::id(), self.number);
        self.folder.join(format!(".{name}.{process}.{number}.tmp"))
    }
}

impl Drop for Output {
    /// Undoes all that was not committed. Errors here have nobody to tell.
    fn drop(&mut self) {
        for file in self.pending.iter().rev() {
            let _ = match (&file.kept, file.is_placed) {
                (Some(kept), true) => fs::rename(kept, &file.target),
                (None, true) => fs::remove_file(&file.target),
                (Some(kept), false) => fs::remove_file(kept).and(fs::remove_file(&file.temp)),
                (None, false) => fs::remove_file(&file.temp),
            };
        }
        self.made
            .iter()
            .rev()
            .for_each(|folder| drop(fs::remove_dir(folder)));
    }
}

/// Writes one file whole or not at all, making its folder if need be.
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<Written, IoError> {
    let name = path
        .file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .unwrap_or_default();
    let mut output = Output::open(path.parent().unwrap_or(Path::new(".")))?;
    output.add(&name, bytes)?;
    let mut written = output.commit()?;
    Ok(written.swap_remove(0))
}

/// The folders above and at `folder` that do not exist yet, outermost first.
fn missing(folder: &Path) -> Vec<PathBuf> {
    let up = folder
        .ancestors()
        .take_while(|p| !p.as_os_str().is_empty() && !p.exists());
    let mut missing: Vec<PathBuf> = up.map(Path::to_path_buf).collect();
    missing.reverse();
    missing
}

/// Creates a file that did not exist; a planted link is not followed.
fn create(path: &Path) -> io::Result<File> {
    // A file of this name can only be left from a killed process that had our number.
    let _ = fs::remove_file(path);
    OpenOptions::new().write(true).create_new(true).open(path)
}

fn fill(mut file: File, bytes: &[u8]) -> io::Result<()> {
    file.write_all(bytes)?;
    file.sync_all()
}

/// Forces a folder's names to the disk; systems that cannot open folders need not.
fn sync(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()
    } else {
        Ok(())
    }
}

/// `name` if it is one plain file name, as [`Output::add`] takes them.
pub fn writable(name: &str) -> Result<&str, IoError> {
    let is_plain = !name.is_empty() && !name.starts_with('.') && !name.contains(is_foreign);
    if is_plain {
        return Ok(name);
    }
    let fault = Fault::new("bad-name", name, "not a name for a file to write");
    Err(fault
        .allowed("letters, digits, dashes, dots inside")
        .refused())
}

/// A text with dashes where no name of a file may have what it has.
pub fn as_name(text: &str) -> String {
    text.replace(is_foreign, "-")
}

/// What no name of a file may have on some system.
fn is_foreign(c: char) -> bool {
    "/\\:".contains(c) || c.is_control()
}

/// The system's refusal to write `size` bytes at `path`.
pub(crate) fn unwritable(path: &Path, size: u64, err: &io::Error) -> IoError {
    let fault = |code, what, hint: String| {
        Fault::new(code, error::name(path), what)
            .hint(hint)
            .found(err)
            .disk()
    };
    match err.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            let hint = format!("this file needs {}; free some space there", mebibytes(size));
            fault("disk-full", "the disk is full, nothing was written", hint)
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            let hint = "choose another folder with -o, or change its permissions";
            fault("cannot-write", "you may not write here", hint.into())
        }
        io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists => fault(
            "cannot-write",
            "this is a file, not a folder",
            "choose another folder with -o".into(),
        ),
        _ => fault(
            "cannot-write",
            "cannot be written",
            "choose another folder with -o".into(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    fn text(folder: &Folder, name: &str) -> String {
        fs::read_to_string(folder.path().join(name)).expect("the file is there")
    }

    #[test]
    fn files_appear_together_and_replace_what_was_there() {
        let folder = Folder::new("output-together");
        folder.put("a", b"old");
        let mut output = Output::open(folder.path()).expect("the folder is there");
        output.add("a", b"new").expect("there is room");
        output.add("b", b"first").expect("there is room");
        output.add("b", b"second").expect("there is room");
        assert_eq!(text(&folder, "a"), "old");
        let written = output.commit().expect("nothing is in the way");
        let sizes: Vec<u64> = written.iter().map(|w| w.bytes).collect();
        assert_eq!(
            (sizes, folder.names()),
            (vec![3, 6], vec!["a".into(), "b".into()])
        );
        assert_eq!(
            (text(&folder, "a"), text(&folder, "b")),
            ("new".into(), "second".into())
        );
    }

    #[test]
    fn given_up_it_leaves_no_trace() {
        let folder = Folder::new("output-dropped");
        folder.put("a", b"old");
        let deep = folder.path().join("x/y/z");
        let mut output = Output::open(&deep).expect("folders can be made");
        output.add("a", b"new").expect("there is room");
        drop(output);
        assert_eq!(folder.names(), ["a"]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told_with_the_bytes_needed_and_leaves_no_trace() {
        let folder = Folder::new("output-full");
        folder.put("a", b"old");
        let mut output = Output::open(&folder.path().join("out")).expect("folders can be made");
        output
            .add("fine", b"this one has room")
            .expect("there is room");
        output.create = |_| OpenOptions::new().write(true).open("/dev/full");
        let err = output
            .add("big", &[0; 2 << 20])
            .expect_err("/dev/full is full");
        assert_eq!((err.code(), err.exit_code()), ("disk-full", 5));
        assert!(
            err.hint().contains("2.0 MiB") && err.to_string().contains("big"),
            "{err}"
        );
        drop(output);
        assert_eq!(folder.names(), ["a"]);
    }

    #[test]
    fn a_commit_that_fails_half_way_is_undone() {
        let folder = Folder::new("output-undone");
        folder.put("a", b"old");
        let mut output = Output::open(folder.path()).expect("the folder is there");
        for name in ["a", "b", "c"] {
            output.add(name, b"new").expect("there is room");
        }
        // Somebody makes a folder where the last file must go.
        fs::create_dir(folder.path().join("c")).expect("the folder can be written");
        let err = output.commit().expect_err("a folder stands in the way");
        assert_eq!(err.exit_code(), 5);
        assert_eq!(
            (folder.names(), text(&folder, "a")),
            (vec!["a".into(), "c".into()], "old".into())
        );
    }

    #[test]
    fn an_output_that_is_a_file_is_refused_at_once() {
        let folder = Folder::new("output-file");
        let file = folder.put("out", b"x");
        for path in [file.clone(), file.join("deeper")] {
            let err = Output::open(&path).err().expect("a file is no folder");
            assert_eq!((err.code(), err.exit_code()), ("cannot-write", 5), "{err}");
        }
        assert_eq!(folder.names(), ["out"]);
    }

    #[test]
    fn a_name_cannot_lead_out_of_the_folder() {
        let folder = Folder::new("output-names");
        let mut output = Output::open(folder.path()).expect("the folder is there");
        for name in [
            "", "..", "../a", "/etc/a", "a/b", "a\\b", "c:a", ".hidden", "a\nb",
        ] {
            assert_eq!(
                output.add(name, b"").expect_err("not plain").exit_code(),
                4,
                "{name:?}"
            );
        }
    }

    #[test]
    fn one_file_is_written_with_its_folder() {
        let folder = Folder::new("output-one");
        let path = folder.path().join("new/a.txt");
        assert_eq!(write_file(&path, b"abc").expect("it can").bytes, 3);
        assert_eq!(fs::read(&path).expect("it is there"), b"abc");
        assert_eq!(write_file(&path, b"d").expect("it can again").path, path);
    }

    #[test]
    fn two_outputs_of_one_process_share_a_folder() {
        let folder = std::env::temp_dir().join(format!("muslin-two-{}", std::process::id()));
        let mut outputs = [Output::open(&folder), Output::open(&folder)]
            .map(|output| output.expect("a folder for temporary files"));
        for (k, output) in outputs.iter_mut().enumerate() {
            let bytes = [k as u8; 4];
            output.add(&format!("{k}.bin"), &bytes).expect("space");
        }
        for output in outputs {
            output.commit().expect("both are whole");
        }
        assert_eq!(fs::read(folder.join("0.bin")).ok(), Some(vec![0; 4]));
        assert_eq!(fs::read(folder.join("1.bin")).ok(), Some(vec![1; 4]));
        fs::remove_dir_all(&folder).expect("ours");
    }
}
