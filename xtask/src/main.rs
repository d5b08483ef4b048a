//! Keeping house: continuous integration, embedded assets, opt-in checks.
//!
//! `cargo xtask ci` is all that continuous integration runs. `assets` rebuilds what is committed
//! under `assets/`; `check` compares against other people's programs in throw-away environments, and
//! `peers` makes the one that `muslin bench cloth --peers` runs.

mod assets_body;
mod assets_pose;
mod assets_wardrobe;
mod check_body;
mod check_ccd;
mod check_cuda;
mod check_gltf;
mod check_npz;
mod check_pose;
mod ci;
mod peers;
mod python;
mod sha256;
mod walls;
mod wheel;

use std::process::ExitCode;

const USAGE: &str = "usage: cargo xtask ci | walls | assets body|garments|pose|swings|terms|wardrobe | check body|ccd|cuda|gltf|npz|pose | peers [ARGS]";

/// Every job says in words what went wrong.
pub(crate) type Outcome = Result<(), String>;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = args.iter().map(String::as_str).collect();
    match run(&words) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("xtask: {message}");
            ExitCode::FAILURE
        }
    }
}

fn run(words: &[&str]) -> Outcome {
    match words {
        ["ci"] => ci::run(),
        ["walls"] => walls::check(),
        ["assets", "body", rest @ ..] => assets_body::build(rest.first().copied()),
        ["assets", "garments"] => assets_wardrobe::cut(),
        ["assets", "pose", rest @ ..] => assets_pose::build(rest.first().copied()),
        ["assets", "swings"] => assets_wardrobe::swing(),
        ["assets", "terms"] => assets_wardrobe::terms(),
        ["assets", "wardrobe", rest @ ..] => assets_wardrobe::build(rest),
        ["check", "body", rest @ ..] => check_body::run(rest),
        ["check", "ccd", rest @ ..] => check_ccd::run(rest),
        ["check", "cuda"] => check_cuda::run(),
        ["check", "gltf", rest @ ..] => check_gltf::run(rest),
        ["check", "npz", rest @ ..] => check_npz::run(rest),
        ["check", "pose", rest @ ..] => check_pose::run(rest),
        ["peers", rest @ ..] => peers::run(rest),
        _ => Err(USAGE.to_owned()),
    }
}
