//! What there is: garments, fabrics, poses, motions.

use muslin_body::{Pose, motions as built_in};
use muslin_garment::Fabric;

use crate::outfit::WARDROBE;
use crate::table::Table;

/// The wardrobe.
pub fn garments() -> Table {
    let mut table = Table::new(&["garment", "fabric", "what it is"]);
    for e in &WARDROBE {
        table.row([e.name, e.fabric, e.says]);
    }
    table
}

/// The fabrics, in SI units or the ones on data sheets.
pub fn fabrics() -> Table {
    let mut table = Table::new(&[
        "fabric",
        "g/m2",
        "mm",
        "warp N/m",
        "weft N/m",
        "shear N/m",
        "warp uNm",
        "weft uNm",
        "friction",
        "limit %",
        "bends cm",
        "drape %",
        "trust",
        "source",
    ]);
    for f in Fabric::presets() {
        let limit = f
            .strain_limit
            .map_or("-".to_owned(), |l| format!("{:.1}", l * 100.0));
        let [warp, weft] = f.bending_length().map(|c| 100.0 * c);
        let drape = f.drape().map(|[a, b]| format!("{a:.0}-{b:.0}"));
        table.row([
            f.name.clone(),
            format!("{:.0}", f.density * 1e3),
            format!("{:.2}", f.thickness * 1e3),
            format!("{:.0}", f.stretch_warp),
            format!("{:.0}", f.stretch_weft),
            format!("{:.0}", f.shear),
            format!("{:.1}", f.bend_warp * 1e6),
            format!("{:.1}", f.bend_weft * 1e6),
            format!("{:.2}", f.friction),
            limit,
            format!("{warp:.1} {weft:.1}"),
            drape.unwrap_or_else(|| "-".into()),
            format!("{:?}", f.confidence).to_lowercase(),
            f.source.clone(),
        ]);
    }
    table
}

/// The built-in poses.
pub fn poses() -> Table {
    let mut table = Table::new(&["pose", "what it is"]);
    for (name, says) in Pose::stances() {
        table.row([name, says]);
    }
    table
}

/// The built-in motions.
pub fn motions() -> Table {
    let mut table = Table::new(&["motion", "what it is"]);
    for (name, says) in built_in::NAMES.iter().zip(built_in::SAYS) {
        table.row([name, says]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_list_names_what_users_are_told_of() {
        assert!(garments().text().contains("tee"));
        assert!(fabrics().text().contains("cotton-jersey"));
        assert!(poses().text().contains("walk"));
        assert!(motions().text().contains("cartwheel"));
        assert!(fabrics().json().contains("\"fabric\": \"denim\""));
    }
}
