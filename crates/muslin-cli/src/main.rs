//! The command line: parse, make the job, run it.

mod args;
mod show;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    show::guard_against_panics();
    let cli = args::Cli::parse();
    show::exit(show::run(&cli.verb))
}
