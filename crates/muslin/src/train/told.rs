//! What a training says of itself.

use std::path::PathBuf;

use muslin_geom::Report;
use muslin_io::sha256;
use muslin_train::Told;

use crate::brought::is_file;
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

/// Stands in a source before the hash of the file that it came in.
pub(super) const FROM_FILE: &str = " sha256:";

/// What was learnt from, and what its owners ask.
pub(crate) struct Learnt<'a> {
    /// Whether the body is a character's.
    pub is_character: bool,
    /// The garment, one of ours or a file's.
    pub garment: &'a str,
    /// Motions, as a model names them.
    pub sources: &'a [String],
    /// The terms of all that came in files, where they are said.
    pub terms: Option<&'a str>,
}

impl Learnt<'_> {
    /// The terms of everything that was learnt from.
    pub fn licence(&self) -> String {
        // What came in a file has its hash.
        let is_built_in = |s: &String| !s.contains(FROM_FILE);
        let from_file = is_file(self.garment);
        let ours = [
            (!self.is_character, "body CC0"),
            (!from_file, "garment Apache-2.0 OR MIT"),
            (
                self.sources.iter().any(is_built_in),
                "built-in motions Apache-2.0 OR MIT",
            ),
        ];
        let theirs = [
            (self.is_character, "body"),
            (from_file, "garment"),
            (
                !self.sources.iter().all(is_built_in),
                "recordings (trained_on)",
            ),
        ];
        let listed = |list: [(bool, &'static str); 3]| -> Vec<&str> {
            list.into_iter().filter(|e| e.0).map(|e| e.1).collect()
        };
        let mut all: Vec<String> = listed(ours).into_iter().map(str::to_owned).collect();
        let theirs = listed(theirs);
        if !theirs.is_empty() {
            let terms = self.terms.unwrap_or("their owners' terms");
            all.push(format!("{} under {terms}", theirs.join(", ")));
        }
        all.join("; ")
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_says_whose_terms_each_thing_is_under_that_it_learnt_from() {
        let built_in = ["built-in walk".to_owned()];
        let both = ["built-in walk".to_owned(), "a.bvh sha256:01".to_owned()];
        let own = Learnt {
            is_character: false,
            garment: "tee",
            sources: &built_in,
            terms: None,
        };
        assert_eq!(
            own.licence(),
            "body CC0; garment Apache-2.0 OR MIT; built-in motions Apache-2.0 OR MIT"
        );
        let theirs = Learnt {
            is_character: true,
            garment: "suit.obj#2",
            sources: &both[1..],
            ..own
        };
        let all = "body, garment, recordings (trained_on) under";
        assert_eq!(theirs.licence(), format!("{all} their owners' terms"));
        let said = Learnt {
            terms: Some("CC BY 4.0, Jane Doe"),
            ..theirs
        };
        assert_eq!(said.licence(), format!("{all} CC BY 4.0, Jane Doe"));
        let mixed = Learnt {
            is_character: false,
            garment: "tee",
            sources: &both,
            terms: None,
        };
        assert!(mixed.licence().contains("built-in motions"));
        let named_so = ["built-in.bvh sha256:02".to_owned()];
        let file = Learnt {
            sources: &named_so,
            ..mixed
        };
        assert!(!file.licence().contains("built-in motions"));
        assert!(
            mixed
                .licence()
                .ends_with("; recordings (trained_on) under their owners' terms")
        );
    }
}
