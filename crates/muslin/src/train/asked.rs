//! What a training was asked for, so that it can be asked for again.

use muslin_train::published::{StretchLaw, System};

use super::options::{Skinning, TrainOptions};

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
        say("from", file.display().to_string());
    }
    if let Some(edge) = options.coarse {
        say("coarse", (edge * 1000.0).to_string());
    }
    say("seed", options.seed.to_string());
    list.join(" ")
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
