//! A journal: records that a long job adds to a file while it works, so that it can go on later.
//!
//! Each record carries its length and SHA-256. A record is forced to the disk before the job goes
//! on; one that a killed job left half-written is not read and is cut off by the next. While a job has
//! it open it is locked, and no other job may.
//! Layout: `MUSLINJ1`, then for each record its length (`u64`, little end first), the 64
//! hexadecimal digits of its hash, and its bytes.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::{Fault, IoError, name};
use crate::input::read_file;
use crate::lock::take;
use crate::output::{unwritable, write_file};
use crate::sha256::sha256;

const MAGIC: &[u8; 8] = b"MUSLINJ1";
/// Bytes before those of a record.
const HEAD: usize = 8 + 64;
/// Files with more bytes are refused.
const MAX_BYTES: u64 = 16 << 30;

/// A journal that is open at its end.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    found: Vec<Vec<u8>>,
}

impl Journal {
    /// A new journal with one record, whole on the disk; one that stood there is replaced, if nobody writes it.
    pub fn create(path: &Path, first: &[u8]) -> Result<Self, IoError> {
        Self::ask(path)?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend(record(first));
        write_file(path, &bytes)?;
        Self::at_end(path)
    }

    /// A journal that was left, ready for more records; none if there is no such file.
    pub fn open(path: &Path) -> Result<Option<Self>, IoError> {
        if !path.exists() {
            return Ok(None);
        }
        let mut journal = Self::at_end(path)?;
        let input = read_file(path, MAX_BYTES)?;
        let Some(mut rest) = input.bytes.strip_prefix(MAGIC) else {
            let fault = Fault::new("not-a-journal", name(path), "no unfinished job of Muslin");
            return Err(fault.hint("remove it, or start without --resume").invalid());
        };
        let mut records = Vec::new();
        while let Some((bytes, after)) = next(rest) {
            records.push(bytes.to_vec());
            rest = after;
        }
        let whole = (input.bytes.len() - rest.len()) as u64;
        let cut = journal.file.set_len(whole);
        cut.map_err(|e| unwritable(path, 0, &e))?;
        journal.found = records;
        Ok(Some(journal))
    }

    /// The whole records that were there when the journal was opened; a second time none.
    pub fn take_records(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.found)
    }

    /// Adds a record; when this returns, it is on the disk.
    pub fn append(&mut self, bytes: &[u8]) -> Result<(), IoError> {
        let written = self.file.write_all(&record(bytes));
        let synced = written.and_then(|()| self.file.sync_data());
        synced.map_err(|e| unwritable(&self.path, bytes.len() as u64, &e))
    }

    /// Whether a job may write a journal at `path`: a fault, if another one does.
    pub fn ask(path: &Path) -> Result<(), IoError> {
        match path.exists() {
            true => Self::at_end(path).map(|_| ()),
            false => Ok(()),
        }
    }

    /// Removes the journal at `path`, if there is one that nobody writes.
    pub fn remove(path: &Path) -> Result<(), IoError> {
        if matches!(Self::ask(path), Err(IoError::Busy(_))) {
            return Ok(());
        }
        match fs::remove_file(path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(unwritable(path, 0, &e)),
            _ => Ok(()),
        }
    }

    fn at_end(path: &Path) -> Result<Self, IoError> {
        let file = OpenOptions::new().append(true).open(path);
        let file = file.map_err(|e| unwritable(path, 0, &e))?;
        take(&file, path)?;
        Ok(Self {
            path: path.to_owned(),
            file,
            found: Vec::new(),
        })
    }
}

fn record(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(HEAD + bytes.len());
    out.extend((bytes.len() as u64).to_le_bytes());
    out.extend(sha256(bytes).as_bytes());
    out.extend(bytes);
    out
}

/// The record at the start of `rest` and what follows it; none if it is not whole.
fn next(rest: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, after) = rest.split_first_chunk::<8>()?;
    let (hash, after) = after.split_first_chunk::<64>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (bytes, after) = after.split_at_checked(length)?;
    (sha256(bytes).as_bytes() == hash).then_some((bytes, after))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file in a folder of its own, removed in the end.
    struct Place(PathBuf);

    impl Place {
        fn new(name: &str) -> Self {
            let file = format!("muslin-journal-{}-{name}", std::process::id());
            let folder = std::env::temp_dir().join(file);
            fs::create_dir_all(&folder).expect("a temporary folder");
            Self(folder.join("job.part"))
        }
    }

    impl Drop for Place {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(self.0.parent().expect("its folder"));
        }
    }

    fn records(path: &Path) -> Vec<Vec<u8>> {
        let open = Journal::open(path).expect("readable");
        open.expect("it is there").take_records()
    }

    #[test]
    fn records_come_back_and_a_torn_one_is_cut_off_wherever_it_tore() {
        let place = Place::new("torn");
        assert!(Journal::open(&place.0).expect("no fault").is_none());
        let mut journal = Journal::create(&place.0, b"one").expect("writable");
        journal.append(b"").expect("writable");
        let whole = fs::read(&place.0).expect("readable").len();
        journal.append(b"three").expect("writable");
        drop(journal);
        let all = fs::read(&place.0).expect("readable");
        assert_eq!(
            records(&place.0),
            [b"one".to_vec(), vec![], b"three".to_vec()]
        );
        for cut in whole..all.len() {
            fs::write(&place.0, &all[..cut]).expect("writable");
            let mut journal = Journal::open(&place.0).expect("whole").expect("there");
            assert_eq!(journal.take_records().len(), 2, "cut at {cut}");
            journal.append(b"again").expect("writable");
            drop(journal);
            assert_eq!(records(&place.0)[2], b"again");
        }
        Journal::remove(&place.0).expect("removable");
        Journal::remove(&place.0).expect("nothing to remove is no fault");
    }

    #[test]
    fn one_job_at_a_time_has_a_journal() {
        let place = Place::new("busy");
        let mut journal = Journal::create(&place.0, b"one").expect("writable");
        let others = [
            Journal::open(&place.0).err(),
            Journal::create(&place.0, b"two").err(),
            Journal::ask(&place.0).err(),
        ];
        for fault in others {
            let fault = fault.expect("another job writes it");
            assert_eq!((fault.code(), fault.exit_code()), ("busy", 8), "{fault}");
        }
        Journal::remove(&place.0).expect("left to the other");
        journal.append(b"three").expect("writable");
        drop(journal);
        assert_eq!(records(&place.0), [b"one".to_vec(), b"three".to_vec()]);
    }

    #[test]
    fn a_flipped_bit_ends_the_reading_and_another_file_is_refused() {
        let place = Place::new("flipped");
        Journal::create(&place.0, b"one").expect("writable");
        let mut bytes = fs::read(&place.0).expect("readable");
        *bytes.last_mut().expect("bytes") ^= 1;
        fs::write(&place.0, &bytes).expect("writable");
        assert!(records(&place.0).is_empty());
        fs::write(&place.0, b"MUSLINxx").expect("writable");
        assert!(Journal::open(&place.0).is_err());
    }
}
