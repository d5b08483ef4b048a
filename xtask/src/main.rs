//! Keeping house: assets, checks and continuous integration.
fn main() {}
