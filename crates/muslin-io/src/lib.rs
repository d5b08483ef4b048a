//! The only room that knows file formats and opens files.
