//! What a job gives back: the same facts as a short table and as JSON.

use muslin_geom::Report;
use muslin_io::report_json;

use crate::failure::Failure;

/// What came out, and how good it is.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A short table for people.
    pub table: String,
    /// The report for programs.
    pub json: String,
    /// What the job ends with all the same.
    pub fault: Option<Failure>,
}

impl Outcome {
    /// A table and the report it was taken from.
    pub fn new(table: String, report: &Report) -> Self {
        Self {
            table,
            json: report_json(report),
            fault: None,
        }
    }

    /// Several outcomes, one after the other; the JSON becomes a list.
    pub fn all(parts: Vec<Self>) -> Self {
        let table = parts
            .iter()
            .map(|p| p.table.as_str())
            .collect::<Vec<_>>()
            .join("\n\n");
        let json = parts
            .iter()
            .map(|p| p.json.trim_end())
            .collect::<Vec<_>>()
            .join(",\n");
        Self {
            table,
            json: format!("[\n{json}\n]\n"),
            fault: parts.into_iter().find_map(|p| p.fault),
        }
    }

    /// What came of several jobs, of which some failed; the fault alone where nothing did.
    pub(crate) fn with_fault(parts: Vec<Self>, fault: Failure) -> Result<Self, Failure> {
        if parts.is_empty() {
            return Err(fault);
        }
        Ok(Self {
            fault: Some(fault),
            ..Self::all(parts)
        })
    }
}
