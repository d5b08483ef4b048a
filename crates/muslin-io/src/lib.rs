//! The only room that knows file formats and opens files.
//!
//! Readers take bytes and a name for messages, check limits before they allocate, and return
//! values that are whole. Writers build bytes in memory; `Output` puts them on disk so that
//! nobody ever sees half a file.

mod error;
mod input;
mod photo;
mod sha256;
mod sniff;
#[cfg(test)]
mod testing;

pub use error::{Fault, IoError, Place, name, quote};
pub use input::{Input, read_file};
pub use photo::{Photo, PhotoLimits, decode_photo, flatten, read_photo};
pub use sha256::sha256;
pub use sniff::{Kind, sniff};
