//! Beginning with what another model knows.

use glam::DVec3;
use muslin_geom::Surface;
use muslin_model::{Encoder, Model};
use muslin_net::learn::Mlp;

use crate::TrainError;
use crate::lesson::Lesson;
use crate::training::sum;

/// Cloth farther from another's than this has nothing to learn from it [m].
const FAR: f64 = 0.1;

/// Refuses a model that the encoder cannot go on from, or that was told other traits.
pub(crate) fn fits(model: &Model, encoder: &Mlp, lesson: &Lesson<'_>) -> Result<(), TrainError> {
    let names = |t: &&str| (*t).to_owned();
    let told: Vec<String> = lesson.traits.iter().map(|t| names(&t.0)).collect();
    let known: Vec<&String> = model.traits.iter().map(|t| &t.name).collect();
    let same = [
        ("network", model.encoder == Encoder::Plain(encoder.clone())),
        ("traits", told.iter().eq(known)),
    ];
    match same.into_iter().find(|s| !s.1) {
        Some((what, _)) => Err(TrainError::OtherModel(what)),
        None => Ok(()),
    }
}

/// Which model it is, in short.
pub(crate) fn identity(model: &Model) -> u64 {
    let scale = model.scale.as_flattened().iter();
    let all = scale.chain(&model.params).chain(&model.modes);
    sum(&mut all.map(|x| f64::from(*x)))
}

/// The model's shapes for cloth that lies at `template` [m] around the same body and may have other triangles:
/// three rows a vertex, one column a code.
pub(crate) fn shapes(model: &Model, template: &[DVec3]) -> Result<Vec<f32>, TrainError> {
    let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
    let verts: Vec<DVec3> = model.template.iter().map(wide).collect();
    let surface = Surface::new(&verts, &model.faces);
    let row = 3 * model.n_codes();
    let mut out = Vec::with_capacity(template.len() * row);
    for x in template {
        let near = surface.closest(*x, FAR);
        let near = near.ok_or(TrainError::OtherModel("garment"))?;
        let corners = model.faces[near.face as usize].map(|v| v as usize);
        for k in 0..row {
            let one = |(v, w): (&usize, &f64)| *w as f32 * model.modes[v * row + k];
            out.push(corners.iter().zip(&near.weights).map(one).sum());
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use super::*;
    use crate::Training;
    use crate::testing::Class;
    use crate::{Plan, Trainer};

    static CLASS: LazyLock<Class> = LazyLock::new(Class::new);

    #[test]
    fn a_training_that_begins_with_a_model_starts_where_it_ended() {
        let mut first = CLASS.trainer();
        while first.steps() < 30 {
            first.step().expect("finite");
        }
        let model = first.model(Default::default());
        let plan = Plan {
            codes: 8,
            hidden: vec![16],
            steps: 40,
            ..Plan::default()
        };
        let begin = |model: &Model, plan: &Plan| {
            let poses = CLASS.poses.clone();
            Trainer::begun(vec![CLASS.lesson()], plan.clone(), poses, model)
        };
        let again = begin(&model, &plan).expect("the same garment");
        let wave = CLASS.wave();
        let (was, is, new) = (
            first.judge(&wave).energies.total(),
            again.judge(&wave).energies.total(),
            CLASS.trainer().judge(&wave).energies.total(),
        );
        // The first has not yet all of the skin's stiffness.
        assert!(is - was < 0.3 * (new - was), "{was} {is} {new}");
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(close(&again.model(Default::default()).modes, &model.modes));
        assert_eq!(again.model(Default::default()).scale, model.scale);

        let told = |model: &Model, plan: &Plan| match begin(model, plan) {
            Err(e) => e.to_string(),
            Ok(_) => String::new(),
        };
        let wider = Plan {
            hidden: vec![32],
            ..plan.clone()
        };
        assert!(told(&model, &wider).contains("network"));
        let mut far = model.clone();
        far.template.iter_mut().for_each(|p| p[1] += 2.0);
        assert!(told(&far, &plan).contains("garment"));
        // What was kept of one is not gone on with by the other.
        let mut fresh = CLASS.trainer();
        assert!(fresh.restore(&again.keep()).is_err());
        let mut other = model.clone();
        other.modes[5] += 1e-3;
        let mut beside = begin(&other, &plan).expect("the same garment");
        assert!(beside.restore(&again.keep()).is_err());
        let mut same = begin(&model, &plan).expect("the same garment");
        assert!(same.restore(&again.keep()).is_ok());
    }
}
