//! The command line: a thin door.
fn main() {}
