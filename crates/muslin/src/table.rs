//! A small table for people (aligned text) and programs (JSON).

use muslin_geom::{Report, Value};
use muslin_io::plain;

/// Rows of cells under headings.
#[derive(Clone, Debug, Default)]
pub struct Table {
    headings: Vec<&'static str>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table.
    pub fn new(headings: &[&'static str]) -> Self {
        Self {
            headings: headings.to_vec(),
            rows: Vec::new(),
        }
    }

    /// Adds a row; missing cells stay empty. What a terminal would act on is escaped.
    pub fn row<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>) -> &mut Self {
        let cells = cells.into_iter().map(|c| plain(c.as_ref()));
        self.rows.push(cells.collect());
        self
    }

    /// Aligned columns, the last one unpadded.
    pub fn text(&self) -> String {
        let heads: Vec<String> = self.headings.iter().map(|h| (*h).to_owned()).collect();
        let all: Vec<&Vec<String>> = std::iter::once(&heads).chain(&self.rows).collect();
        let columns = all.iter().map(|r| r.len()).max().unwrap_or(0);
        let width = |c: usize| {
            all.iter()
                .filter_map(|r| r.get(c))
                .map(|s| s.chars().count())
                .max()
                .unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let line = |r: &&Vec<String>| {
            let cells = r.iter().zip(&widths).map(|(s, w)| format!("{s:<w$}"));
            cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
        };
        let lines = all
            .iter()
            .filter(|r| r.iter().any(|c| !c.is_empty()))
            .map(line);
        lines.collect::<Vec<_>>().join("\n")
    }

    /// A list of objects named by the headings.
    pub fn json(&self) -> String {
        let rows = self.rows.iter().map(|row| {
            let mut object = Report::default();
            for (name, cell) in self.headings.iter().zip(row) {
                object.set(name, cell.as_str());
            }
            Value::Tree(object)
        });
        let mut report = Report::default();
        report.set("rows", rows.collect::<Vec<_>>());
        muslin_io::report_json(&report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let mut t = Table::new(&["name", "x"]);
        t.row(["a", "1"]).row(["long name", "2"]);
        assert_eq!(t.text(), "name       x\na          1\nlong name  2");
    }

    #[test]
    fn names_from_files_cannot_drive_a_terminal() {
        let mut t = Table::new(&[]);
        t.row(["walk\u{1b}[2J\u{202e}"]);
        assert_eq!(t.text(), "walk\\u{1b}[2J\\u{202e}");
    }
}
