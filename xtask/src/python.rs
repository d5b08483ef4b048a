//! Throw-away Python environments.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The environment in `home`, made if need be, with `packages` in it; its interpreter.
pub fn environment(home: &Path, packages: &[&str]) -> Result<PathBuf, String> {
    let python = home.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    });
    if !python.exists() {
        done(Command::new("python3").args(["-m", "venv"]).arg(home))?;
    }
    let pip = ["-m", "pip", "install", "-q", "--disable-pip-version-check"];
    done(Command::new(&python).args(pip).args(packages))?;
    Ok(python)
}

/// Runs a program whose words are for the user.
fn done(command: &mut Command) -> Result<(), String> {
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{command:?}: {status}")),
        Err(e) => Err(format!("{command:?}: {e}")),
    }
}
