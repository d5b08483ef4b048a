//! What a training says of itself.

use std::path::PathBuf;

use muslin_geom::Report;
use muslin_io::sha256;
use muslin_train::Told;

use crate::table::Table;

/// Costs as they stand in the report.
pub(super) fn energies(told: &Told) -> Report {
    let mut r = Report::default();
    for (name, value) in told.energies.terms() {
        r.set(&format!("{name}_J"), value);
    }
    r.set("under_percent", 100.0 * told.under);
    r
}

/// A hash of the triangles: models of other triangles are not for this garment.
pub(crate) fn topology(faces: &[[u32; 3]]) -> String {
    let bytes: Vec<u8> = faces
        .as_flattened()
        .iter()
        .flat_map(|i| i.to_le_bytes())
        .collect();
    sha256(&bytes)
}

/// The terms of everything that was learnt from.
pub(super) fn licence(sources: &[String]) -> String {
    let own = "body CC0; built-in motions and garment Apache-2.0 OR MIT";
    match sources.iter().all(|s| s.starts_with("built-in")) {
        true => own.into(),
        false => format!("{own}; recordings under their owners' terms: see trained_on"),
    }
}

/// What is printed at the end.
pub(super) fn table(last: &Told, files: &[(PathBuf, Vec<u8>)]) -> String {
    let mut table = Table::new(&[]);
    table.row(["learnt", &format!("{} steps", last.step)]);
    let told = last.energies.terms().into_iter().filter(|t| t.1 != 0.0);
    let terms: Vec<String> = told.map(|(n, v)| format!("{n} {v:.4}")).collect();
    table.row(["J a pose", &terms.join(", ")]);
    table.row([
        "contact",
        &format!("{:.3} % of the cloth under the skin", 100.0 * last.under),
    ]);
    for (i, (path, _)) in files.iter().enumerate() {
        table.row([
            if i == 0 { "wrote" } else { "" },
            &path.display().to_string(),
        ]);
    }
    table.text()
}
