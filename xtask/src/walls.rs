//! The walls of the house: which room may use which, read from ARCHITECTURE.md.
//!
//! The table's rows read `| floor | room | sentence | may use |`. Every crate must stand in the
//! table, every arrow of its manifest must be allowed there and every arrow of the table drawn, and arrows point to
//! lower floors. Modules that may be `unsafe` are named there as well.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::Outcome;

struct Room {
    floor: u32,
    may_use: Vec<String>,
}

/// Compares every crate's manifest and `unsafe` module with the tables in ARCHITECTURE.md.
pub fn check() -> Outcome {
    let root = root();
    let plan = read(&root.join("ARCHITECTURE.md"))?;
    let rooms = table(&plan)?;
    let mut faults = Vec::new();
    for (name, uses) in manifests(&root)? {
        faults.extend(faults_of(&name, &uses, &rooms));
    }
    let mut sources = Vec::new();
    sources_in(&root.join("crates"), &mut sources)?;
    for path in sources {
        if is_unsafe(&read(&path)?) {
            let name = path.strip_prefix(root.join("crates")).unwrap_or(&path);
            let name = name.to_string_lossy().replace('\\', "/");
            if !plan.contains(&format!("`{name}`")) {
                faults.push(format!("{name} is unsafe, and not named as such"));
            }
        }
    }
    if faults.is_empty() {
        Ok(())
    } else {
        Err(format!("walls:\n  {}", faults.join("\n  ")))
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn table(plan: &str) -> Result<BTreeMap<String, Room>, String> {
    let mut rooms = BTreeMap::new();
    for line in plan.lines() {
        let cells: Vec<&str> = line.trim_matches('|').split('|').map(str::trim).collect();
        let [floor, name, _, may_use] = cells[..] else {
            continue;
        };
        let (Ok(floor), Some(name)) = (floor.parse(), name.strip_prefix('`')) else {
            continue;
        };
        let may_use = may_use.split(',').map(|s| s.trim().to_owned()).collect();
        rooms.insert(
            name.trim_end_matches('`').to_owned(),
            Room { floor, may_use },
        );
    }
    if rooms.is_empty() {
        Err("no table of rooms in ARCHITECTURE.md".into())
    } else {
        Ok(rooms)
    }
}

/// Every crate with the workspace crates its manifest names outside `[dev-dependencies]`.
fn manifests(root: &Path) -> Result<Vec<(String, Vec<String>)>, String> {
    let mut found = Vec::new();
    let folder = fs::read_dir(root.join("crates")).map_err(|e| e.to_string())?;
    for entry in folder {
        let path = entry.map_err(|e| e.to_string())?.path();
        let name = path
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        found.push((name, uses(&read(&path.join("Cargo.toml"))?)));
    }
    found.sort();
    Ok(found)
}

/// All Rust files below a folder.
fn sources_in(folder: &Path, into: &mut Vec<PathBuf>) -> Result<(), String> {
    for entry in fs::read_dir(folder).map_err(|e| e.to_string())? {
        let path = entry.map_err(|e| e.to_string())?.path();
        if path.is_dir() {
            sources_in(&path, into)?;
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
    Ok(())
}

fn is_unsafe(source: &str) -> bool {
    // Of a whole file, or of one thing in it.
    let attributes = source
        .lines()
        .map(str::trim_start)
        .filter(|l| l.starts_with('#'));
    let mut allowed = attributes.filter(|l| l.contains("allow(") && l.contains("unsafe_code"));
    allowed.next().is_some()
}

fn uses(manifest: &str) -> Vec<String> {
    let mut section = "";
    let mut names = Vec::new();
    for line in manifest.lines().map(str::trim) {
        if line.starts_with('[') {
            section = line;
        } else if section == "[dependencies]" && line.starts_with("muslin") {
            let end = line
                .find(|c: char| !(c.is_alphanumeric() || c == '-'))
                .unwrap_or(line.len());
            names.push(line[..end].to_owned());
        }
    }
    names
}

fn faults_of(name: &str, uses: &[String], rooms: &BTreeMap<String, Room>) -> Vec<String> {
    let Some(room) = rooms.get(name) else {
        return vec![format!("{name} has no row in ARCHITECTURE.md")];
    };
    let mut faults = Vec::new();
    for far in &room.may_use {
        let is_drawn = |u: &String| u.strip_prefix("muslin-").unwrap_or(u) == far;
        if !far.is_empty() && far != "all below" && !uses.iter().any(is_drawn) {
            faults.push(format!("{name} does not use {far}, as its row says"));
        }
    }
    for other in uses {
        let short = other.strip_prefix("muslin-").unwrap_or(other);
        let allowed = room.may_use.iter().any(|m| m == short || m == "all below");
        if !allowed {
            faults.push(format!("{name} uses {other}, which its row does not allow"));
        }
        if rooms.get(other).is_some_and(|r| r.floor >= room.floor) {
            faults.push(format!(
                "{name} uses {other}, which is not on a lower floor"
            ));
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: &str = "| 1 | `muslin-a` | low | |\n| 2 | `muslin-b` | high | a |\n";

    #[test]
    fn the_house_keeps_its_walls() {
        check().expect("manifests follow ARCHITECTURE.md");
    }

    #[test]
    fn an_arrow_that_points_up_is_found() {
        let rooms = table(PLAN).unwrap();
        assert!(faults_of("muslin-b", &["muslin-a".into()], &rooms).is_empty());
        assert_eq!(faults_of("muslin-a", &["muslin-b".into()], &rooms).len(), 2);
        assert_eq!(faults_of("muslin-b", &[], &rooms).len(), 1);
        assert_eq!(faults_of("muslin-c", &[], &rooms).len(), 1);
    }

    #[test]
    fn what_allows_unsafe_code_is_found_wherever_it_stands() {
        let allow =
            ["#![allow(unsafe_", "    #[allow(unsafe_"].map(|a| format!("{a}code)]\nfn f() {{}}"));
        assert!(allow.iter().all(|source| is_unsafe(source)));
        assert!(!is_unsafe("// allow(unsafe_code)\n#![forbid(unsafe_code)]"));
    }

    #[test]
    fn only_real_dependencies_count() {
        let m =
            "[dependencies]\nmuslin-geom.workspace = true\n[dev-dependencies]\nmuslin-io = {}\n";
        assert_eq!(uses(m), ["muslin-geom"]);
    }

    #[test]
    fn what_is_unsafe_says_so_at_its_head() {
        assert!(is_unsafe(
            "//! Kernels.\n\n#![allow(unsafe_code)] // registers\n"
        ));
        assert!(!is_unsafe(
            "// #![allow(unsafe_code)]\nlet a = \"#![allow(unsafe_code)]\";\n"
        ));
    }
}
