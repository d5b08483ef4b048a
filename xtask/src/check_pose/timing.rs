//! The time of both networks, ours and the reference's in turn, one thread each.

use muslin_io::PoseGraphs;
use muslin_net::{Graph, Net, Scratch};

use super::reference::Reference;
use super::tensors::made_up;

/// Runs of each; the least counts.
const RUNS: usize = 20;
/// Most times the reference's time for both networks together.
const MOST: f64 = 2.0;

/// Prints a row per network; returns what is too slow.
pub fn compare(graphs: &PoseGraphs, reference: &mut Reference) -> Result<Vec<String>, String> {
    let mut rows = [
        Row::new("detector", &graphs.detector, &[0, 1])?,
        Row::new("landmarks", &graphs.landmarks, &[0, 1, 3, 4])?,
        Row::new("landmarks", &graphs.landmarks, &[0, 1, 2, 3, 4])?,
    ];
    for _ in 0..RUNS {
        for row in &mut rows {
            row.theirs = row.theirs.min(reference.time(row.model)?);
            row.ours = row.ours.min(row.once()?);
        }
    }
    for (row, what) in rows
        .iter()
        .zip(["", " (without the mask)", " (with the mask)"])
    {
        let ratio = row.ours / row.theirs;
        let Row {
            model,
            ours,
            theirs,
            ..
        } = row;
        println!("{model}{what}: {ours:.2} ms CPU, reference {theirs:.2} ms, ratio {ratio:.2}");
    }
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!(
        "least of {RUNS} interleaved runs, one thread each; load {}",
        load.trim()
    );
    let ratio = (rows[0].ours + rows[1].ours) / (rows[0].theirs + rows[1].theirs);
    println!("both networks as the product runs them: {ratio:.2} times the reference");
    if cfg!(debug_assertions) {
        println!("a checked build; to judge time: cargo run --release -p xtask -- check pose");
        return Ok(Vec::new());
    }
    Ok((ratio > MOST)
        .then(|| format!("{ratio:.2} times the reference's time"))
        .into_iter()
        .collect())
}

struct Row {
    model: &'static str,
    net: Net,
    input: Vec<f32>,
    scratch: Scratch,
    ours: f64,
    theirs: f64,
}

impl Row {
    fn new(model: &'static str, graph: &Graph, outputs: &[usize]) -> Result<Self, String> {
        let net = Net::new(graph, outputs).map_err(|e| e.to_string())?;
        let input = made_up("waves", &net.input_shapes()[0], 0.0);
        let scratch = Scratch::default();
        Ok(Self {
            model,
            net,
            input,
            scratch,
            ours: f64::INFINITY,
            theirs: f64::INFINITY,
        })
    }

    /// CPU milliseconds of one run.
    fn once(&mut self) -> Result<f64, String> {
        let start = spent()?;
        self.net
            .run(&[&self.input], &mut self.scratch)
            .map_err(|e| e.to_string())?;
        Ok(spent()? - start)
    }
}

/// CPU milliseconds of this thread so far.
fn spent() -> Result<f64, String> {
    let path = "/proc/thread-self/schedstat";
    let text = std::fs::read_to_string(path).map_err(|e| format!("{path}: {e}"))?;
    let nanos = text.split(' ').next().and_then(|w| w.parse::<f64>().ok());
    nanos
        .map(|n| n / 1e6)
        .ok_or_else(|| format!("{path}: {text:?}"))
}
