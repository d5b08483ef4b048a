//! Fabrics by name or from a file that the user brings.

use std::ops::RangeInclusive;
use std::path::Path;

use muslin_garment::Fabric;
use muslin_io::read_fabric;

use crate::dress::file_failure;
use crate::failure::{Exit, Failure};

/// What a fabric of a file may weigh [g/m²]: from the finest film to mail of iron rings.
const WEIGHTS: RangeInclusive<f64> = 1.0..=20_000.0;

/// Whether an asked fabric is a file rather than the name of a preset.
pub(crate) fn is_file(asked: &str) -> bool {
    has_kind(asked) || asked.contains(['/', '\\'])
}

/// Whether a file is of a kind that fabrics are read from, by its name.
pub(crate) fn has_kind(name: &str) -> bool {
    let kind = Path::new(name).extension().and_then(|e| e.to_str());
    let kind = kind.map(str::to_lowercase);
    kind.is_some_and(|k| ["toml", "json", "u3m", "u3ma"].contains(&k.as_str()))
}

/// The preset of a name or the fabric of a file (TOML, or the physics of U3M and U3MA), and what there is to say
/// about it.
pub(crate) fn find(asked: &str) -> Result<(Fabric, Vec<String>), Failure> {
    if is_file(asked) {
        let file = read_fabric(Path::new(asked)).map_err(|e| file_failure(&e))?;
        let grams = file.fabric.density * 1e3;
        if !WEIGHTS.contains(&grams) {
            let what = format!(
                "no cloth weighs {grams} g/m2 (allowed {} to {})",
                WEIGHTS.start(),
                WEIGHTS.end()
            );
            let fault = Failure::new(Exit::Refused, "fabric-weight", what).at(asked);
            return Err(
                fault.hint("give the weight in grams a square metre: 150 is a jersey, 400 denim")
            );
        }
        let mut own = file.fabric;
        // A preset's name alone would stand for the preset in every file that tells what its cloth is made of.
        if Fabric::named(&own.name).is_ok_and(|preset| preset != own) {
            own.name = format!("own-{}", own.name);
        }
        return Ok((own, file.warnings));
    }
    Ok((named(asked)?, Vec::new()))
}

/// The preset of a name.
pub(crate) fn named(asked: &str) -> Result<Fabric, Failure> {
    let unknown = |e: muslin_garment::FabricError| {
        Failure::new(Exit::Usage, "unknown-fabric", e.to_string())
            .at("--fabric")
            .hint("muslin list fabrics shows all; a file of your own may be named instead")
    };
    Fabric::named(asked).map_err(unknown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_a_preset_and_a_file_is_read() {
        assert_eq!(find("denim").expect("a preset").0.name, "denim");
        let folder = std::env::temp_dir().join(format!("muslin-fabric-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let path = folder.join("own.toml");
        std::fs::write(&path, "like = \"denim\"\nmass_g_m2 = 350\n").expect("a small file");
        let own = find(&path.to_string_lossy()).expect("a fabric file").0;
        assert_eq!((own.name.as_str(), own.density), ("own", 0.35));
        let like = folder.join("denim.toml");
        std::fs::write(&like, "like = \"denim\"\nmass_g_m2 = 60\n").expect("a small file");
        let other = find(&like.to_string_lossy()).expect("a fabric file").0;
        assert_eq!((other.name.as_str(), other.density), ("own-denim", 0.06));
        // What somebody else's file calls its cloth leads to no file.
        let name = named(&path.to_string_lossy()).expect_err("a name alone");
        assert_eq!(name.code, "unknown-fabric");
        std::fs::remove_dir_all(&folder).expect("our own folder");
        let gone = find(&path.to_string_lossy()).expect_err("it is gone");
        assert_eq!(gone.exit, Exit::Files);
    }
}
