//! What a training was asked for, so that it can be asked for again.

use std::path::Path;

use muslin_io::read_file;
use muslin_model::Precision;
use muslin_train::published::{StretchLaw, System};

use super::options::{Skinning, TrainOptions};
use crate::brought::{is_file, numbered};
use crate::fabric;
use crate::options::Wear;

/// Garments and fabrics are not larger [bytes].
const MOST_HASHED: u64 = 512 << 20;

/// The options that the result depends on besides who wears what and the motions, as the command line says them; what was not
/// said with its usual value.
pub(super) fn asked(options: &TrainOptions) -> String {
    let mut list = Vec::new();
    let mut say = |name: &str, value: String| list.push(format!("--{name} {value}"));
    say("steps", options.steps.to_string());
    say("poses", options.poses.to_string());
    if !options.is_moving() {
        say(
            "mixed",
            options.mixed.unwrap_or(TrainOptions::MIXED).to_string(),
        );
    }
    match options.system {
        None => ours(options, &mut say),
        Some(system) => theirs(options, system, &mut say),
    }
    if let Some(skinning) = options.skinning {
        let how = match skinning {
            Skinning::Given => "given",
            Skinning::Learnt => "learnt",
        };
        say("skinning", how.into());
    }
    if let Some(file) = &options.from {
        // Where it lies is nobody else's business.
        let name = file.file_name().unwrap_or_default();
        say("from", name.to_string_lossy().into_owned());
    }
    if let Some(edge) = options.coarse {
        say("coarse", (edge * 1000.0).to_string());
    }
    if let Some(precision) = options.weights {
        let numbers = match precision {
            Precision::Single => "f32",
            Precision::Half => "f16",
            Precision::Twelve => "i12",
            Precision::Eight => "i8",
        };
        say("weights", numbers.into());
    }
    say("seed", options.seed.to_string());
    list.join(" ")
}

/// Which files of garment and fabric it is made of, by hash; nothing where both are ours.
pub(super) fn hashes(wear: &Wear) -> String {
    let garment = is_file(&wear.garment).then(|| numbered(&wear.garment).0);
    let cloth = wear.fabric.as_deref().filter(|f| fabric::is_file(f));
    let one = |file: &str| {
        let input = read_file(Path::new(file), MOST_HASHED).ok()?;
        Some(format!("{file} {}", input.sha256()))
    };
    let all: Vec<String> = [garment, cloth]
        .into_iter()
        .flatten()
        .filter_map(one)
        .collect();
    all.join("; ")
}

fn ours(options: &TrainOptions, say: &mut impl FnMut(&str, String)) {
    let plan = options.plan();
    let numbers = [
        ("codes", plan.codes as f64),
        ("width", plan.hidden.first().map_or(0.0, |w| *w as f64)),
        ("relax", plan.relaxed as f64),
    ];
    numbers
        .into_iter()
        .for_each(|(name, x)| say(name, x.to_string()));
    say("rate", plan.rate.to_string());
    say("fairness", plan.fairness.to_string());
}

fn theirs(options: &TrainOptions, system: System, say: &mut impl FnMut(&str, String)) {
    let course = options.paper_course(system);
    say("rate", course.rate.to_string());
    match system {
        System::Pbns => {
            if course.one_way {
                say("stop-gradient", String::new());
            }
        }
        System::Snug => {
            say("layers", course.layers.to_string());
            say("warm", course.warm.to_string());
        }
        System::Ncs => {
            say("width", course.width.to_string());
            say("augment", course.augmented.to_string());
            let law = match course.stretch {
                StretchLaw::MassSpring => "mass-spring",
                StretchLaw::StVk => "stvk",
                StretchLaw::BaraffWitkin => "baraff-witkin",
            };
            say("stretch", law.into());
            if !course.gravity {
                say("without-gravity", String::new());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_of_the_same_name_are_another_training() {
        let folder = std::env::temp_dir().join(format!("muslin-asked-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a temporary folder");
        let file = folder.join("own.toml");
        let worn = Wear {
            garment: "tee".into(),
            fabric: Some(file.display().to_string()),
        };
        let told = ["mass_g_m2 = 60", "mass_g_m2 = 300"].map(|text| {
            std::fs::write(&file, text).expect("a small file");
            hashes(&worn)
        });
        std::fs::remove_dir_all(&folder).expect("our own folder");
        assert!(
            told[0].contains("own.toml ") && told[0] != told[1],
            "{told:?}"
        );
        assert_eq!(hashes(&Wear::parse("tee:denim")), "");
    }

    #[test]
    fn every_option_of_a_system_is_told_and_none_of_another() {
        let told = |system| {
            asked(&TrainOptions {
                system,
                rate: Some(0.002),
                seed: 7,
                ..TrainOptions::default()
            })
        };
        let ours = told(None);
        for option in [
            "--steps ",
            "--mixed 900",
            "--codes 64",
            "--rate 0.002",
            "--fairness 1.5",
            "--seed 7",
        ] {
            assert!(ours.contains(option), "{option}: {ours}");
        }
        assert!(!ours.contains("--weights"), "{ours}");
        let rough = asked(&TrainOptions {
            weights: Some(Precision::Eight),
            ..TrainOptions::default()
        });
        assert!(rough.contains("--weights i8"), "{rough}");
        let usual = asked(&TrainOptions {
            system: Some(System::Pbns),
            ..TrainOptions::default()
        });
        assert!(usual.contains("--rate 0.001 "), "{usual}");
        let snug = told(Some(System::Snug));
        assert!(
            snug.contains("--layers 4 --warm 30") && !snug.contains("--mixed"),
            "{snug}"
        );
        let ncs = told(Some(System::Ncs));
        assert!(
            ncs.contains("--augment 0.2 --stretch baraff-witkin"),
            "{ncs}"
        );
        assert!(
            !ncs.contains("--codes") && !ncs.contains("--fairness"),
            "{ncs}"
        );
    }
}
