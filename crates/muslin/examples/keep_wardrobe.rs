//! `cargo run --release --package muslin --example keep_wardrobe -- cuts|swings FOLDER`: the wardrobe's garments, cut
//! beforehand; or the trained ones, their swings found anew.

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args_os().skip(1);
    let what = args.next().unwrap_or_default();
    let (files, ending) = match what.to_str() {
        Some("cuts") => (muslin::cut_beforehand()?, "cut"),
        Some("swings") => (muslin::swung_anew()?, "muslin"),
        _ => return Err("usage: keep_wardrobe cuts|swings FOLDER".into()),
    };
    let folder = args.next().map(PathBuf::from);
    let folder = folder.ok_or("usage: keep_wardrobe cuts|swings FOLDER")?;
    for (name, bytes) in files {
        let path = folder.join(format!("{name}.{ending}"));
        std::fs::write(&path, &bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
