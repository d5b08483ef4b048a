//! `cargo run --release --package muslin --example keep_wardrobe -- cuts|swings FOLDER`: the wardrobe's garments, cut
//! beforehand; or the trained ones, their swings found anew. `-- terms FOLDER TERMS`: these, saying under what terms the
//! recordings are that they learnt from.

use std::error::Error;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args_os().skip(1);
    let what = args.next().unwrap_or_default();
    let usage = "usage: keep_wardrobe cuts|swings FOLDER | terms FOLDER TERMS";
    let folder = args.next().map(PathBuf::from).ok_or(usage)?;
    let terms = args.next();
    let terms = terms.as_ref().and_then(|t| t.to_str());
    let (files, ending) = match (what.to_str(), terms) {
        (Some("cuts"), None) => (muslin::cut_beforehand()?, "cut"),
        (Some("swings"), None) => (muslin::swung_anew()?, "muslin"),
        (Some("terms"), Some(terms)) => (muslin::under_terms(terms)?, "muslin"),
        _ => return Err(usage.into()),
    };
    for (name, bytes) in files {
        let path = folder.join(format!("{name}.{ending}"));
        std::fs::write(&path, &bytes).map_err(|e| format!("{}: {e}", path.display()))?;
        println!("{} {} bytes", path.display(), bytes.len());
    }
    Ok(())
}
