//! `cargo run --release --package muslin --example swing_garments -- FOLDER`: the trained garments, their swings found
//! anew.

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.ok_or("usage: swing_garments FOLDER")?;
    for (name, bytes) in muslin::swung_anew()? {
        let path = folder.join(format!("{name}.muslin"));
        std::fs::write(&path, &bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
