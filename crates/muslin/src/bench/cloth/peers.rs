//! Our simulator beside other people's, on one moving skirt, in turns.
//!
//! Every round runs each contender once, ours first; the others are programs of their own in an
//! environment that `cargo xtask peers` made. Each tells the time of every frame without what it
//! needs to get ready. All frames are then judged by the code behind `muslin evaluate`.

mod contender;
mod skirt;

use std::path::Path;

use glam::{DVec2, DVec3, Vec3Swizzles};
use muslin_geom::Value;
use muslin_io::{Clip, write_file};

use super::super::clock;
use crate::dress::file_failure;
use crate::evaluate::{evaluate, mean};
use crate::failure::{Exit, Failure};
use crate::table::Table;
use contender::{Take, ours, theirs};
use skirt::{FRAMES, Skirt};

/// Ourselves: steps to a frame. The first is how we are used; the second, as fine in time as others
/// are, is the yardstick for how much of the motion everybody keeps.
const OURS: [(&str, usize); 2] = [("Muslin", 1), ("Muslin, 10 steps a frame", 10)];

/// A program to compare with: its name, script and settings, and by how many times it should take
/// longer than we do, at least and as a goal.
struct Peer {
    name: &'static str,
    script: &'static str,
    setting: &'static str,
    gate: f64,
    goal: f64,
}

const PEERS: [Peer; 4] = [
    Peer {
        name: "Newton VBD 10x10, self-contact",
        script: "peers_newton.py",
        setting: "vbd",
        gate: 20.0,
        goal: 60.0,
    },
    Peer {
        name: "Newton Style3D 10x4x10",
        script: "peers_newton.py",
        setting: "style3d",
        gate: 5.0,
        goal: 12.0,
    },
    Peer {
        name: "Blender quality 5, collisions 2",
        script: "peers_blender.py",
        setting: "5,2",
        gate: 3.0,
        goal: 8.0,
    },
    Peer {
        name: "Blender quality 15, collisions 5",
        script: "peers_blender.py",
        setting: "15,5",
        gate: 15.0,
        goal: 40.0,
    },
];

/// What a contender did in all rounds so far.
#[derive(Default)]
struct Record {
    /// Times of all frames [ms]: by the clock, and of all the processor's cores.
    wall: Vec<f64>,
    cpu: Vec<f64>,
    /// The frames of the last round.
    clip: Option<Clip>,
    /// Versions, as the program tells them.
    made_by: String,
    /// Why a round gave nothing.
    fault: Option<String>,
}

/// Runs everybody `rounds` times, with the peers' environment in `home`; all files go to `out`.
///
/// # Errors
/// If `out` cannot be written. A peer that fails is a row that says why.
pub fn peers(home: &Path, (rounds, out): (usize, &Path)) -> Result<String, Failure> {
    let skirt = Skirt::new();
    write_scene(&skirt, out)?;
    let mut records: Vec<Record> = (0..OURS.len() + PEERS.len())
        .map(|_| Record::default())
        .collect();
    let mut loads = Vec::new();
    for round in 1..=rounds.max(1) {
        loads.push(clock::load());
        for (k, record) in records.iter_mut().enumerate() {
            let (name, taken) = match k.checked_sub(OURS.len()) {
                None => (OURS[k].0, ours(&skirt, OURS[k].1)),
                Some(p) => (PEERS[p].name, theirs(&PEERS[p], home, out)),
            };
            record.take(taken);
            eprintln!("round {round}, {name}: {}", record.told());
        }
    }
    loads.push(clock::load());
    write_ours(&records, out)?;
    let [times, quality] = [times(&records), judged(&records, &skirt)];
    let faults = faults(&records);
    let loads = loads.join(", ");
    Ok(format!(
        "{times}{faults}\n\n{quality}\n\n{rounds} rounds in turns; {loads}"
    ))
}

fn write_scene(skirt: &Skirt, out: &Path) -> Result<(), Failure> {
    for (name, text) in skirt.files().map_err(|e| file_failure(&e))? {
        write_file(&out.join(name), text.as_bytes()).map_err(|e| file_failure(&e))?;
    }
    Ok(())
}

fn write_ours(records: &[Record], out: &Path) -> Result<(), Failure> {
    for ((_, steps), record) in OURS.iter().zip(records) {
        let Some(clip) = &record.clip else { continue };
        let bytes = clip.npz().map_err(|e| file_failure(&e))?;
        let path = out.join(format!("Muslin-{steps}.npz"));
        write_file(&path, &bytes).map_err(|e| file_failure(&e))?;
    }
    Ok(())
}

impl Record {
    fn take(&mut self, taken: Result<Take, String>) {
        match taken {
            Ok(take) => {
                self.wall.extend(take.wall);
                self.cpu.extend(take.cpu);
                (self.clip, self.made_by) = (Some(take.clip), take.made_by);
            }
            Err(why) => self.fault = Some(why),
        }
    }

    fn told(&self) -> String {
        match (&self.fault, median(&self.wall)) {
            (Some(why), _) => why.clone(),
            (None, ms) => format!("{ms:.1} ms a frame so far"),
        }
    }
}

/// NaN of nothing.
fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

/// Names beside records, ours first.
fn named(
    records: &[Record],
) -> impl Iterator<Item = (&'static str, Option<&'static Peer>, &Record)> {
    let peers = PEERS.iter().map(|p| (p.name, Some(p)));
    let names = OURS.iter().map(|o| (o.0, None)).chain(peers);
    names.zip(records).map(|((name, peer), r)| (name, peer, r))
}

/// Time a frame, and by how many times ours it is.
fn times(records: &[Record]) -> String {
    let headings = [
        "contender",
        "ms/frame",
        "mean",
        "CPU ms",
        "times ours",
        "gate",
        "goal",
        "holds",
        "made by",
    ];
    let mut table = Table::new(&headings);
    let ours = median(&records[0].wall);
    for (name, peer, r) in named(records) {
        if r.wall.is_empty() {
            table.row([name, "failed"]);
            continue;
        }
        let wall = median(&r.wall);
        let mut row = vec![name.to_owned()];
        row.extend([wall, mean(r.wall.iter().copied()), median(&r.cpu)].map(|t| format!("{t:.1}")));
        row.push(format!("{:.1}", wall / ours));
        if let Some(p) = peer {
            row.extend([p.gate, p.goal].map(|x| format!("{x:.1}")));
            row.push(if wall / ours >= p.gate { "yes" } else { "no" }.into());
        }
        row.resize(8, String::new());
        row.push(r.made_by.clone());
        table.row(row);
    }
    table.text()
}

/// A line for everybody who failed in some round.
fn faults(records: &[Record]) -> String {
    let said = |(name, _, r): (_, _, &Record)| Some(format!("\n{name}: {}", r.fault.as_ref()?));
    named(records).filter_map(said).collect()
}

/// What the judge finds in everybody's last round.
fn judged(records: &[Record], skirt: &Skirt) -> String {
    let mut table = Table::new(&[
        "contender",
        "lost frames",
        "deeper than 0.5 mm",
        "deepest mm",
        "frames crossing",
        "most crossings",
        "worst stretch %",
        "waist strays mm",
        "hem swings deg",
        "hem rises mm",
        "from 10 steps mm",
    ]);
    let fine = records[OURS.len() - 1].clip.as_ref();
    for (name, _, record) in named(records) {
        let Some(clip) = &record.clip else {
            continue;
        };
        let cells = figures((clip, fine), skirt).unwrap_or_else(|e| vec![e.what]);
        table.row([vec![name.to_owned()], cells].concat());
    }
    table.text()
}

fn figures((clip, fine): (&Clip, Option<&Clip>), skirt: &Skirt) -> Result<Vec<String>, Failure> {
    let same = clip.drape.faces == skirt.cloth.faces && clip.drape.frames.len() == FRAMES + 1;
    if !same {
        return Err(Failure::new(
            Exit::Invalid,
            "another-scene",
            "not this cloth, or not these frames",
        ));
    }
    let report = evaluate(clip, None)?.report;
    let of = |group: &str, name: &str| match report.get(group) {
        Some(Value::Tree(tree)) => match tree.get(name) {
            Some(Value::Number(x)) => *x,
            _ => f64::NAN,
        },
        _ => f64::NAN,
    };
    Ok(vec![
        format!("{}", of("clip", "non_finite_frames")),
        format!("{}", of("contact", "deeper_than_half_a_mm")),
        format!("{:.2}", of("contact", "depth_max_mm")),
        format!("{}", of("self", "frames_with_crossings")),
        format!("{}", of("self", "edge_triangle_crossings_max")),
        format!("{:.1}", 100.0 * (of("stretch", "principal_max") - 1.0)),
        format!("{:.2}", 1e3 * strays(clip, skirt)),
        format!("{:.0}", most(clip, |x| swing(x, skirt).to_degrees().abs())),
        format!("{:.0}", most(clip, |x| 1e3 * rise(x, skirt))),
        fine.map_or(String::new(), |f| format!("{:.1}", 1e3 * apart(clip, f))),
    ])
}

fn most(clip: &Clip, of: impl Fn(&[DVec3]) -> f64) -> f64 {
    clip.drape.frames.iter().map(|x| of(x)).fold(0.0, f64::max)
}

/// How far the hem has turned about its own middle [rad], on average.
fn swing(x: &[DVec3], skirt: &Skirt) -> f64 {
    let hem = || skirt.hem.iter().map(|&i| i as usize);
    let middle = hem().map(|i| x[i].xz()).sum::<DVec2>() / skirt.hem.len() as f64;
    let turned = |i: usize| (x[i].xz() - middle).angle_to(skirt.cloth.verts[i].xz());
    hem().map(turned).sum::<f64>() / skirt.hem.len() as f64
}

/// How far the hem is above its start [m], on average.
fn rise(x: &[DVec3], skirt: &Skirt) -> f64 {
    let up = |&i: &u32| x[i as usize].y - skirt.cloth.verts[i as usize].y;
    skirt.hem.iter().map(up).sum::<f64>() / skirt.hem.len() as f64
}

/// Root mean square distance of all vertices in all frames [m].
fn apart(clip: &Clip, other: &Clip) -> f64 {
    let pairs = clip.drape.frames.iter().zip(&other.drape.frames);
    let squares = pairs.flat_map(|(a, b)| a.iter().zip(b).map(|(p, q)| p.distance_squared(*q)));
    let (sum, n) = squares.fold((0.0, 0), |(sum, n), d| (sum + d, n + 1));
    (sum / f64::from(n)).sqrt()
}

/// How far a vertex of the waist is at most from where the body takes it [m].
fn strays(clip: &Clip, skirt: &Skirt) -> f64 {
    let waist = |k: usize| {
        let all = skirt.moved(&skirt.cloth.verts, k);
        let off = |&i: &u32| all[i as usize].distance(clip.drape.frames[k][i as usize]);
        skirt.pinned.iter().map(off).fold(0.0, f64::max)
    };
    (0..=FRAMES).map(waist).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(wall: &[f64]) -> Record {
        Record {
            wall: wall.to_vec(),
            cpu: wall.to_vec(),
            ..Record::default()
        }
    }

    #[test]
    fn ratios_are_those_of_medians() {
        let mut all: Vec<Record> = [10.0, 80.0, 250.0, 40.0, 30.0, 150.0]
            .map(|ms| record(&[ms, 0.5 * ms, 9.0 * ms]))
            .into();
        all[5] = Record {
            fault: Some("no such program".into()),
            ..Record::default()
        };
        let table = times(&all);
        let cells = |row: usize| -> Vec<&str> {
            let line = table.lines().nth(row).expect("a row");
            line.split_whitespace().rev().take(4).collect()
        };
        assert_eq!(cells(3), ["yes", "60.0", "20.0", "25.0"]);
        assert_eq!(cells(4), ["no", "12.0", "5.0", "4.0"]);
        assert_eq!(cells(5), ["yes", "8.0", "3.0", "3.0"]);
        assert!(table.lines().nth(6).expect("a row").ends_with("failed"));
        assert!(faults(&all).ends_with("collisions 5: no such program"));
    }

    #[test]
    fn a_skirt_that_moves_as_one_is_judged_clean() {
        let skirt = Skirt::new();
        let mut clip = contender::clip(&skirt);
        clip.drape.frames = (0..=FRAMES)
            .map(|k| skirt.moved(&skirt.cloth.verts, k))
            .collect();
        let cells = figures((&clip, Some(&clip)), &skirt).expect("a sound clip");
        let clean = ["0", "0", "0.00", "0", "0", "0.0", "0.00", "60", "0", "0.0"];
        assert_eq!(cells, clean);
    }
}
