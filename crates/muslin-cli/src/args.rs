//! The words of the command line: a room for every verb, or for a few that are alike.

mod animate;
mod common;
mod dress;
mod judge;
mod simulate;
mod train;

use clap::{Parser, Subcommand, ValueEnum};

pub use animate::Animate;
pub use common::Telling;
pub use dress::{Common, Demo, Dress};
pub use judge::{Bench, BenchKind, Check, Evaluate};
pub use simulate::Simulate;
pub use train::Train;

/// Dresses any body in moving cloth: from a photo to a 3D figure wearing draped garments.
#[derive(Debug, Parser)]
#[command(name = "muslin", version, propagate_version = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// The verbs.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Dress the person in a photo.
    Dress(Dress),
    /// Dress the person in a built-in photo; needs no file.
    Demo(Demo),
    /// Move an outfit on a moving body: an animation of cloth.
    Simulate(Simulate),
    /// Teach a garment to lie on a moving body, without one simulated frame.
    Train(Train),
    /// Play a trained garment on a motion, each frame led to rest by a few solver iterations.
    Animate(Animate),
    /// Show what there is: garments, fabrics, poses or motions.
    List {
        /// What to list.
        what: Kind,
        /// Machine-readable.
        #[arg(long)]
        json: bool,
    },
    /// Say what files are, and whether garments, bodies, motions, fabrics, models and photos can be used.
    Check(Check),
    /// Judge animated cloth: energies, stretch, penetration, crossings, drift.
    Evaluate(Evaluate),
    /// Print the figures of merit, measured on this machine.
    Bench(Bench),
}

/// What `list` can show.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Kind {
    /// Garments and their usual fabrics.
    Garments,
    /// Fabrics in the units of data sheets.
    Fabrics,
    /// Built-in poses.
    Poses,
    /// Built-in motions.
    Motions,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn garments_take_the_common_fabric_unless_they_name_one() {
        let cli = Cli::parse_from([
            "muslin",
            "dress",
            "a.jpg",
            "--garment",
            "tee,trousers:denim",
            "--fabric",
            "silk-charmeuse",
        ]);
        let Verb::Dress(dress) = cli.verb else {
            panic!("dress")
        };
        let outfit = dress.common.options().outfit;
        assert_eq!(outfit[0].fabric.as_deref(), Some("silk-charmeuse"));
        assert_eq!(outfit[1].fabric.as_deref(), Some("denim"));
    }
}
