//! `cargo xtask peers [DIR]`: other people's cloth simulators, for `muslin bench cloth --peers DIR`.
//!
//! Newton and Blender (as the Python module `bpy`) come into a throw-away environment, with the
//! scripts that lead them through our scene. Nothing of theirs is copied into this repository.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::{Outcome, python};

/// Newton with the compiler it stands on.
const NEWTON: [&str; 3] = ["newton==1.8.0", "warp-lang==1.19.0", "numpy"];
/// Blender; which versions there are depends on the version of Python.
const BLENDER: [&str; 1] = ["bpy>=5"];

/// What leads them.
const SCRIPTS: [(&str, &str); 4] = [
    ("peers_scene.py", include_str!("../python/peers_scene.py")),
    ("peers_newton.py", include_str!("../python/peers_newton.py")),
    (
        "peers_blender.py",
        include_str!("../python/peers_blender.py"),
    ),
    (SHIRT, include_str!("../python/peers_shirt.py")),
];

/// Turns Newton's example shirt into a file that everybody reads.
const SHIRT: &str = "peers_shirt.py";

/// Says which versions there are.
const VERSIONS: &str = "
import importlib.metadata as m, platform
print('python', platform.python_version())
for name in ('newton', 'warp-lang', 'bpy', 'numpy'):
    try: print(name, m.version(name))
    except m.PackageNotFoundError: print(name, 'is not here')
";

/// Makes the environment, and says how to use it.
pub fn run(args: &[&str]) -> Outcome {
    let home = match args {
        [] => Path::new("target/peers"),
        [home] => Path::new(home),
        _ => return Err("usage: cargo xtask peers [DIR]".into()),
    };
    let python = python::environment(home, &NEWTON)?;
    if let Err(why) = python::environment(home, &BLENDER) {
        println!("Blender is left out: {why}");
    }
    for (name, text) in SCRIPTS {
        let path = home.join(name);
        fs::write(&path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    }
    let told = Command::new(&python).args(["-c", VERSIONS]).output();
    let told = told.map_err(|e| format!("{}: {e}", python.display()))?;
    print!("{}", String::from_utf8_lossy(&told.stdout));
    let shirt = home.join("newton_shirt.obj");
    let mut convert = Command::new(&python);
    let done = convert.arg(home.join(SHIRT)).arg(&shirt).output();
    let why = match done {
        Ok(d) if d.status.success() => String::new(),
        Ok(d) => format!("{}: {}", d.status, String::from_utf8_lossy(&d.stderr)),
        Err(e) => e.to_string(),
    };
    match why.is_empty() {
        true => println!(
            "muslin simulate --motion walk --garment {}",
            shirt.display()
        ),
        false => println!("Newton's shirt is left out: {why}"),
    }
    println!("muslin bench cloth --peers {}", home.display());
    Ok(())
}
