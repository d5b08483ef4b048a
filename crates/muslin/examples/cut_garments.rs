//! `cargo run --release --package muslin --example cut_garments -- FOLDER`: the wardrobe's garments, cut beforehand.

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    let folder = folder.ok_or("usage: cut_garments FOLDER")?;
    for (name, bytes) in muslin::cut_beforehand()? {
        let path = folder.join(format!("{name}.cut"));
        std::fs::write(&path, &bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
