//! One run of a contender: ours through the simulator's public function, others as programs.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Instant;

use glam::DVec3;
use muslin_geom::Drape;
use muslin_io::npz::{self, Values};
use muslin_io::{Clip, read_file};
use muslin_sim::{Options, State, Walk, simulate};

use super::super::super::clock;
use super::Peer;
use super::skirt::{APART, FPS, FRAMES, GRAVITY, Skirt};

/// Threads for everybody.
const THREADS: usize = 2;
/// Stiffness that holds a vertex of the waist [N/m]: others hold theirs without give.
const WAIST: f64 = 1000.0;
/// Bytes of a peer's answer at most.
const MAX_BYTES: u64 = 1 << 30;

/// One run: times of every frame [ms], and the frames.
pub struct Take {
    pub wall: Vec<f64>,
    pub cpu: Vec<f64>,
    pub clip: Clip,
    pub made_by: String,
}

/// Our own run, `steps` to a frame. The first frame's time holds all that gets ready.
pub fn ours(skirt: &Skirt, steps: usize) -> Result<Take, String> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(THREADS).build();
    let pool = pool.map_err(|e| e.to_string())?;
    let (cloth, start) = (skirt.woven(), &skirt.cloth.verts);
    // From a state, not from rest: nobody else is given time to settle.
    let from = State {
        frame: 1,
        verts: start.clone(),
        velocities: vec![DVec3::ZERO; start.len()],
        ..State::default()
    };
    let walk = Walk {
        faces: &skirt.body.faces,
        rest: &skirt.body.verts,
        frames: steps * FRAMES + 1,
        lead: 0,
        fps: FPS * steps as f64,
        at: &|k| skirt.moved_part(&skirt.body.verts, (k, steps)).into(),
    };
    let options = Options {
        gravity: GRAVITY,
        gap: APART,
        pin: WAIST,
        ..Options::default()
    };
    let mut take = Take::of(skirt);
    let mut since = (clock::spent(), Instant::now());
    let run = pool.install(|| {
        simulate(&cloth, (start, Some(&from)), (&walk, &options), |m| {
            if m.frame.is_multiple_of(steps) {
                take.add(m.verts, &mut since);
            }
            ControlFlow::Continue(())
        })
    });
    run.map_err(|e| e.to_string()).map(|()| take)
}

impl Take {
    /// Nothing yet but the start.
    fn of(skirt: &Skirt) -> Take {
        Take {
            wall: Vec::new(),
            cpu: Vec::new(),
            clip: clip(skirt),
            made_by: format!("{}, {THREADS} threads", env!("CARGO_PKG_VERSION")),
        }
    }

    fn add(&mut self, verts: &[DVec3], since: &mut (Option<f64>, Instant)) {
        let now = (clock::spent(), Instant::now());
        self.wall.push((now.1 - since.1).as_secs_f64() * 1e3);
        self.cpu.extend(now.0.zip(since.0).map(|(b, a)| b - a));
        self.clip.drape.frames.push(verts.to_vec());
        *since = now;
    }
}

/// The clip of the scene, of the cloth its start alone.
pub fn clip(skirt: &Skirt) -> Clip {
    Clip {
        drape: Drape {
            faces: skirt.cloth.faces.clone(),
            frames: vec![skirt.cloth.verts.clone()],
            fps: FPS,
            ..Drape::default()
        },
        body: (0..=FRAMES)
            .map(|k| skirt.moved(&skirt.body.verts, k))
            .collect(),
        body_faces: skirt.body.faces.clone(),
        rest: skirt.cloth.verts.clone(),
        pins: skirt.pinned.clone(),
        ..Clip::default()
    }
}

/// A peer's run, or why there is none.
pub fn theirs(peer: &Peer, home: &Path, out: &Path) -> Result<Take, String> {
    let python = python(home);
    let answer = out.join(format!("{}.npz", peer.name.replace([' ', ','], "-")));
    let _ = std::fs::remove_file(&answer);
    let done = Command::new(&python)
        .arg(home.join(peer.script))
        .args([out, &answer])
        .arg(peer.setting)
        .env("OMP_NUM_THREADS", THREADS.to_string())
        .output()
        .map_err(|e| {
            format!(
                "{}: {e}; make it with `cargo xtask peers`",
                python.display()
            )
        })?;
    if !done.status.success() {
        return Err(format!("{}: {}", done.status, last_words(&done)));
    }
    let input = read_file(&answer, MAX_BYTES).map_err(|e| e.to_string())?;
    let arrays = npz::read(&input.file, &input.bytes).map_err(|e| e.to_string())?;
    let times = |name: &str| {
        let seconds = arrays.floats(name, &[Some(FRAMES)]);
        let ms = |s: Vec<f64>| s.iter().map(|t| 1e3 * t).collect::<Vec<f64>>();
        seconds.map(ms).map_err(|e| e.to_string())
    };
    let made_by = match arrays.get("versions").map(|a| &a.values) {
        Some(Values::Text(words)) => words.join(", "),
        _ => String::new(),
    };
    Ok(Take {
        made_by,
        wall: times("seconds_wall")?,
        cpu: times("seconds_cpu")?,
        clip: Clip::from_npz(&input.file, &input.bytes).map_err(|e| e.to_string())?,
    })
}

fn python(home: &Path) -> PathBuf {
    home.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    })
}

/// The last line that a program wrote.
fn last_words(done: &Output) -> String {
    let text = [&done.stdout[..], &done.stderr[..]].concat();
    let text = String::from_utf8_lossy(&text);
    let last = text.lines().rfind(|l| !l.trim().is_empty());
    last.unwrap_or("it said nothing").trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::super::PEERS;
    use super::*;

    #[test]
    fn an_environment_that_is_not_there_is_a_row() {
        let nowhere = Path::new("no-such-folder");
        let why = theirs(&PEERS[0], nowhere, nowhere)
            .err()
            .expect("nothing to run");
        assert!(why.contains("cargo xtask peers"), "{why}");
    }
}
