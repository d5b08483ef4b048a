//! Time as a user feels it and as the processor spends it.

use std::time::Instant;

/// The least of several runs.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Wall time [ms].
    pub wall: f64,
    /// Processor time of all threads [ms]; absent where the system does not tell.
    pub cpu: Option<f64>,
}

impl Timing {
    /// As in `2.31 ms wall, 2.30 ms CPU`.
    pub fn text(&self) -> String {
        let cpu = self
            .cpu
            .map_or("CPU unknown".to_owned(), |c| format!("{c:.2} ms CPU"));
        format!("{:.2} ms wall, {cpu}", self.wall)
    }
}

/// Shortest batch that is timed [s].
const BATCH: f64 = 0.05;

/// The least mean wall and processor time of a run over `runs` batches of `job`, after one run
/// that does not count; a job of 50 ms or more is a batch of its own.
pub fn least_of<T>(runs: usize, mut job: impl FnMut() -> T) -> Timing {
    let since = Instant::now();
    std::hint::black_box(job());
    let batch = (BATCH / since.elapsed().as_secs_f64().max(1e-9))
        .ceil()
        .clamp(1.0, 1e4);
    let mut best = Timing {
        wall: f64::INFINITY,
        cpu: None,
    };
    for _ in 0..runs {
        let (cpu, since) = (spent(), Instant::now());
        for _ in 0..batch as usize {
            std::hint::black_box(job());
        }
        best.wall = best.wall.min(since.elapsed().as_secs_f64() * 1e3 / batch);
        if let (Some(a), Some(b)) = (cpu, spent()) {
            let took = (b - a) / batch;
            best.cpu = Some(best.cpu.map_or(took, |c: f64| c.min(took)));
        }
    }
    best
}

/// Processor time of all threads so far [ms].
#[cfg(unix)]
pub fn spent() -> Option<f64> {
    use rustix::time::{ClockId, clock_gettime};
    let time = clock_gettime(ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 / 1e6)
}

/// Other systems are not asked.
#[cfg(not(unix))]
pub fn spent() -> Option<f64> {
    None
}

/// The load average over the last minute, which tells how much a figure can be trusted.
pub fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let one = text
        .split_whitespace()
        .next()
        .unwrap_or("unknown")
        .to_owned();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("load {one} on {cores} cores")
}

/// The highest resident memory of this process so far [MiB]; only Linux tells.
pub fn peak_memory() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|l| l.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_time() {
        let t = least_of(3, || {
            (0..200_000_u64).fold(1_u64, |a, b| std::hint::black_box(a.wrapping_mul(b | 1)))
        });
        assert!(t.wall > 0.0 && t.wall.is_finite());
        assert!(t.cpu.is_none_or(|c| c >= 0.0));
    }
}
