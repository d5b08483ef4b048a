//! `cargo xtask check ccd [DIR]`: continuous collision before the public sample queries.
//!
//! DIR is a copy of `github.com/Continuous-Collision-Detection/Sample-Queries` (seen at commit
//! 4d6cce33; it names no licence), or the folder `data` of `Tight-Inclusion` beside it (commit b515e575, MIT), of which
//! forty queries are kept in `xtask/queries`: without DIR it is these. Every folder `edge-edge` or
//! `vertex-face` in it holds tables of eight rows a query: four vertices at the start (the two edges, or
//! the vertex and its face), then the same at the end; three fractions a row, and whether they meet.

use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DVec3;
use muslin_geom::ccd::{self, Keep};

use crate::Outcome;

/// Nothing need be left of a distance; then what the solver leaves of it.
const KEEPS: [(&str, Keep); 2] = [
    ("nothing kept", Keep::NOTHING),
    ("as cloth keeps it", Keep::CLOTH),
];

/// The queries that are kept here.
const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/queries");

/// A query: where four vertices start and end, and whether they meet on the way.
#[derive(Clone, Debug, PartialEq)]
struct Query {
    from: [DVec3; 4],
    to: [DVec3; 4],
    meets: bool,
}

/// What came of a kind of query.
#[derive(Debug, Default)]
struct Tally {
    queries: usize,
    meeting: usize,
    missed: usize,
    alarms: usize,
    micros: Vec<f64>,
}

impl Tally {
    fn add(&mut self, query: &Query, (is_edges, keep): (bool, Keep)) {
        let ways = std::array::from_fn(|i| query.to[i] - query.from[i]);
        let since = Instant::now();
        let share = match is_edges {
            true => ccd::edge_edge(&query.from, &ways, keep),
            false => ccd::vertex_triangle(&query.from, &ways, keep),
        };
        self.micros.push(since.elapsed().as_secs_f64() * 1e6);
        let stopped = share < 1.0;
        self.queries += 1;
        self.meeting += usize::from(query.meets);
        self.missed += usize::from(query.meets && !stopped);
        self.alarms += usize::from(!query.meets && stopped);
    }

    fn told(&mut self) -> String {
        self.micros.sort_unstable_by(f64::total_cmp);
        let n = self.micros.len().max(1);
        let mean = self.micros.iter().sum::<f64>() / n as f64;
        let rare = self.micros.get((n - 1) * 999 / 1000).unwrap_or(&f64::NAN);
        let (queries, meeting, missed) = (self.queries, self.meeting, self.missed);
        format!(
            "{queries} queries, {meeting} meet: {missed} missed, {} false alarms, {mean:.1} us each, \
             99.9 % within {rare:.0} us",
            self.alarms
        )
    }
}

/// Runs all queries; fails if one that meets is missed, or if there are none.
pub fn run(args: &[&str]) -> Outcome {
    let folder = match args {
        [] => &SAMPLE,
        [folder] => folder,
        _ => return Err("usage: cargo xtask check ccd [DIR] (a copy of Sample-Queries)".into()),
    };
    let mut missed = 0;
    let kinds = [("edge-edge", true), ("vertex-face", false)];
    for ((kind, is_edges), (how, keep)) in kinds.iter().flat_map(|k| KEEPS.map(|h| (*k, h))) {
        let mut tally = Tally::default();
        for path in tables(Path::new(folder), kind)? {
            let text = std::fs::read_to_string(&path).map_err(|e| in_file(&path, &e))?;
            let queries = read(&text).map_err(|e| in_file(&path, &e))?;
            queries.iter().for_each(|q| tally.add(q, (is_edges, keep)));
        }
        if tally.queries == 0 {
            return Err(format!("{folder}: no queries in a folder named {kind}"));
        }
        println!("{kind}, {how}: {}", tally.told());
        missed += tally.missed;
    }
    match missed {
        0 => Ok(()),
        n => Err(format!("{n} collisions missed")),
    }
}

fn in_file(path: &Path, what: &dyn std::fmt::Display) -> String {
    format!("{}: {what}", path.display())
}

/// The tables in folders of this name, anywhere in `folder`.
fn tables(folder: &Path, kind: &str) -> Result<Vec<PathBuf>, String> {
    let entries = std::fs::read_dir(folder).map_err(|e| in_file(folder, &e))?;
    let mut out = Vec::new();
    for path in entries.flatten().map(|e| e.path()) {
        let is_table = path.extension().is_some_and(|e| e == "csv");
        if path.is_dir() {
            out.extend(tables(&path, kind)?);
        } else if is_table && folder.ends_with(kind) {
            out.push(path);
        }
    }
    out.sort();
    Ok(out)
}

/// The queries of a table.
fn read(text: &str) -> Result<Vec<Query>, String> {
    let rows = text
        .lines()
        .filter(|l| !l.trim().is_empty() && !l.starts_with('#'))
        .enumerate()
        .map(|(k, l)| row(l).ok_or(format!("row {}: not three fractions and a 0 or 1", k + 1)));
    let rows: Vec<(DVec3, bool)> = rows.collect::<Result<_, _>>()?;
    if !rows.len().is_multiple_of(8) {
        return Err(format!("{} rows are not eight a query", rows.len()));
    }
    let query = |r: &[(DVec3, bool)]| Query {
        from: std::array::from_fn(|i| r[i].0),
        to: std::array::from_fn(|i| r[4 + i].0),
        meets: r[0].1,
    };
    Ok(rows.chunks(8).map(query).collect())
}

/// `x, of, y, of, z, of, meets`.
fn row(line: &str) -> Option<(DVec3, bool)> {
    let numbers: Option<Vec<f64>> = line.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers?[..] {
        [x, xd, y, yd, z, zd, meets] if meets == 0.0 || meets == 1.0 => {
            let at = DVec3::new(x / xd, y / yd, z / zd);
            at.is_finite().then_some((at, meets == 1.0))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point that falls from a half to minus a half, on or beside a face at rest.
    fn falling(x: &str, meets: u8) -> String {
        let face = format!("-1,1,0,1,-1,1,{meets}\n1,1,0,1,-1,1,{meets}\n0,1,0,3,2,2,{meets}\n");
        format!("{x},1,1,2,0,1,{meets}\n{face}{x},1,-1,2,0,1,{meets}\n{face}")
    }

    #[test]
    fn a_table_is_read_and_judged() {
        let queries = read(&(falling("0", 1) + &falling("9", 0))).expect("two queries");
        assert_eq!(queries[0].from[0], DVec3::Y * 0.5);
        assert_eq!(queries[1].to[0], DVec3::new(9.0, -0.5, 0.0));
        assert_eq!(queries[0].to[3], DVec3::Z);
        let mut tally = Tally::default();
        let how = (false, KEEPS[0].1);
        queries.iter().for_each(|q| tally.add(q, how));
        let counts = [tally.queries, tally.meeting, tally.missed, tally.alarms];
        assert_eq!(counts, [2, 1, 0, 0]);
        let lie = Query {
            meets: true,
            ..queries[1].clone()
        };
        tally.add(&lie, how);
        assert_eq!(tally.missed, 1);
    }

    #[test]
    fn of_the_public_queries_none_that_meet_is_missed_and_few_others_are_stopped() {
        assert_eq!(run(&[]), Ok(()));
        for (kind, is_edges, counts) in [
            ("edge-edge", true, [21, 5]),
            ("vertex-face", false, [19, 5]),
        ] {
            let folder = Path::new(SAMPLE).join(kind);
            let table = &tables(&folder, kind).expect("it is there")[0];
            let text = std::fs::read_to_string(table).expect("it can be read");
            let queries = read(&text).expect("a table");
            let mut tally = Tally::default();
            queries
                .iter()
                .for_each(|q| tally.add(q, (is_edges, KEEPS[0].1)));
            assert_eq!([tally.queries, tally.meeting], counts);
            // Five of edges, six of faces do not meet but come within 2.4e-5 of it, where a face is 10 wide.
            assert!(tally.missed == 0 && tally.alarms <= 6, "{}", tally.told());
        }
    }

    #[test]
    fn what_is_no_table_is_refused_with_its_row() {
        let broken = falling("0", 1).replacen("-1,1,0,1", "-1,0,0,1", 1);
        let told = read(&broken).expect_err("a fraction over nothing");
        assert!(told.starts_with("row 2:"), "{told}");
        assert!(read("0,1,0,1,0,1,1\n").is_err_and(|e| e.contains("eight")));
    }
}
