//! The only room that knows file formats and opens files.
//!
//! Readers take bytes and a name for messages, check limits before they allocate, and return
//! values that are whole. Writers build bytes in memory; `Output` puts them on disk so that
//! nobody ever sees half a file.

mod error;

pub use error::{Fault, IoError, Place, name, quote};
