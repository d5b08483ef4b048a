//! What continuous integration runs: format, lints, docs, walls, tests.

use std::process::Command;

use crate::{Outcome, walls};

/// Runs every check in turn and stops at the first that fails.
pub fn run() -> Outcome {
    walls::check()?;
    cargo(&["fmt", "--all", "--check"], &[])?;
    lint(&["--workspace"])?;
    // What a device needs, which the default build leaves out.
    lint(&[
        "--package",
        "muslin-cli",
        "--package",
        "muslin-train",
        "--package",
        "muslin-model",
        "--features",
        "muslin-cli/cuda",
    ])?;
    cargo(
        &["doc", "--workspace", "--no-deps", "--locked"],
        &[("RUSTDOCFLAGS", "-D warnings")],
    )?;
    cargo(&["test", "--workspace", "--locked"], &[])
}

/// Clippy over all targets of these; a warning is a fault.
fn lint(what: &[&str]) -> Outcome {
    let how = ["--all-targets", "--locked", "--", "-D", "warnings"];
    cargo(&[&["clippy"], what, &how].concat(), &[])
}

fn cargo(args: &[&str], env: &[(&str, &str)]) -> Outcome {
    eprintln!("ci: cargo {}", args.join(" "));
    let status = Command::new(env!("CARGO"))
        .args(args)
        .envs(env.iter().copied())
        .status()
        .map_err(|e| format!("cannot start cargo: {e}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("cargo {} failed", args.join(" ")))
    }
}
