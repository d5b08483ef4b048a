//! Beginning with what another model knows.

use glam::DVec3;
use muslin_geom::Surface;
use muslin_model::{Encoder, Model, Skin};
use muslin_net::learn::Mlp;

use crate::TrainError;
use crate::lesson::Lesson;
use crate::training::sum;

/// Cloth farther from another's than this has nothing to learn from it [m].
const FAR: f64 = 0.1;
/// Share of its own weight that a bone keeps at least, where the other cloth does not follow it.
const FAINT: f32 = 1e-3;

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

/// The note of a model that says whether its skin weights are [`LEARNT`]: whoever begins with it takes those on.
pub const SKINNING: &str = "skinning";
/// What that note says where they are.
pub const LEARNT: &str = "learnt";

/// Whether the skin weights of a model were learnt.
pub fn has_learnt_skinning(model: &Model) -> bool {
    model.notes.get(SKINNING).is_some_and(|s| s == LEARNT)
}

/// Which model it is, in short.
pub(crate) fn identity(model: &Model) -> u64 {
    let scale = model.scale.as_flattened().iter();
    let all = scale.chain(&model.params).chain(&model.modes);
    let all = all.chain(&model.skin.weights);
    sum(&mut all.map(|x| f64::from(*x)))
}

/// Where cloth lies on that of a model, which may have other triangles: vertices of the model and their shares, for
/// every vertex.
pub(crate) struct Near(Vec<[(usize, f32); 3]>);

impl Near {
    /// Of cloth that lies at `template` [m] around the same body.
    pub fn new(model: &Model, template: &[DVec3]) -> Result<Self, TrainError> {
        let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
        let verts: Vec<DVec3> = model.template.iter().map(wide).collect();
        let surface = Surface::new(&verts, &model.faces);
        let one = |x: &DVec3| {
            let near = surface.closest(*x, FAR);
            let near = near.ok_or(TrainError::OtherModel("garment"))?;
            let corners = model.faces[near.face as usize];
            Ok([0, 1, 2].map(|k| (corners[k] as usize, near.weights[k] as f32)))
        };
        template.iter().map(one).collect::<Result<_, _>>().map(Self)
    }

    /// The model's shapes for this cloth: three rows a vertex, one column a code.
    pub fn shapes(&self, model: &Model) -> Vec<f32> {
        let row = 3 * model.n_codes();
        let one = |corners: &[(usize, f32); 3], k: usize| {
            let each = corners.iter().map(|(v, w)| w * model.modes[v * row + k]);
            each.sum::<f32>()
        };
        let rows = self.0.iter();
        rows.flat_map(|corners| (0..row).map(move |k| one(corners, k)))
            .collect()
    }

    /// The model's skin weights for this cloth: of the `bones` by name that its `own` ones are of, but those of `pins`
    /// stay, for they are held by bones.
    pub fn skin(&self, model: &Model, (own, bones): (&Skin, &[String]), pins: &[u32]) -> Skin {
        let place = |name: &String| model.bones.iter().position(|b| b == name);
        let places: Vec<Option<usize>> = bones.iter().map(place).collect();
        let mut out = own.clone();
        for (v, corners) in self.0.iter().enumerate() {
            if pins.contains(&(v as u32)) {
                continue;
            }
            let row = own.starts[v] as usize..own.starts[v + 1] as usize;
            for at in row.clone() {
                let bone = places[usize::from(own.bones[at])];
                let of = |v: usize| {
                    let all = model.skin.row(v).filter(|e| Some(e.0) == bone);
                    all.map(|e| e.1).sum::<f32>()
                };
                let weight: f32 = corners.iter().map(|(v, share)| share * of(*v)).sum();
                out.weights[at] = weight.max(FAINT * own.weights[at]);
            }
            let sum: f32 = out.weights[row.clone()].iter().sum();
            out.weights[row].iter_mut().for_each(|w| *w /= sum);
        }
        out
    }
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
        let model = first.model(Default::default()).expect("on cores");
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
            first.judge(&wave).expect("on cores").energies.total(),
            again.judge(&wave).expect("on cores").energies.total(),
            CLASS
                .trainer()
                .judge(&wave)
                .expect("on cores")
                .energies
                .total(),
        );
        // The first has not yet all of the skin's stiffness.
        assert!(is - was < 0.3 * (new - was), "{was} {is} {new}");
        let close = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        assert!(close(
            &again.model(Default::default()).expect("on cores").modes,
            &model.modes
        ));
        assert_eq!(
            again.model(Default::default()).expect("on cores").scale,
            model.scale
        );

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
        assert!(fresh.restore(&again.keep().expect("on cores")).is_err());
        let mut other = model.clone();
        other.modes[5] += 1e-3;
        let mut beside = begin(&other, &plan).expect("the same garment");
        assert!(beside.restore(&again.keep().expect("on cores")).is_err());
        let mut same = begin(&model, &plan).expect("the same garment");
        assert!(same.restore(&again.keep().expect("on cores")).is_ok());
    }

    #[test]
    fn learnt_skin_weights_are_gone_on_with_by_the_bones_names() {
        let plan = Plan {
            skinning: true,
            ..CLASS.trainer().plan
        };
        let lessons = || vec![CLASS.lesson()];
        let mut first = Trainer::new(lessons(), plan.clone(), CLASS.poses.clone()).expect("poses");
        let own = first.skin.clone();
        while first.steps() < 8 {
            first.step().expect("finite");
        }
        let mut model = first.model(Default::default()).expect("on cores");
        let begun = |model: &Model, plan: &Plan| {
            let trainer = Trainer::begun(lessons(), plan.clone(), CLASS.poses.clone(), model);
            trainer.expect("the same garment").skin
        };
        let apart = |a: &Skin, b: &Skin| {
            assert_eq!((&a.starts, &a.bones), (&b.starts, &b.bones));
            let all = a.weights.iter().zip(&b.weights);
            all.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert!(apart(&model.skin, &own) > 0.01);
        assert!(apart(&begun(&model, &plan), &model.skin) < 1e-5);
        // Who does not learn them takes them on where the model says that they are learnt.
        let shapes_alone = CLASS.trainer().plan;
        assert_eq!(apart(&begun(&model, &shapes_alone), &own), 0.0);
        model
            .notes
            .insert(crate::SKINNING.into(), crate::LEARNT.into());
        assert!(apart(&begun(&model, &shapes_alone), &model.skin) < 1e-5);
        // Bones of other numbers are known by their names, and cloth between vertices follows as they do.
        let last = model.bones.len() as u8 - 1;
        model.bones.reverse();
        model.skin.bones.iter_mut().for_each(|b| *b = last - *b);
        assert!(apart(&begun(&model, &plan), &first.skin) < 1e-5);
        let faces = &CLASS.cloth.faces;
        let of = |v: usize| faces.iter().find(|f| f[0] as usize == v);
        let beside = |v: usize| of(v).map_or(v, |f| f[1] as usize);
        let template = &CLASS.template;
        let between = |v: usize| template[v].midpoint(template[beside(v)]);
        let between: Vec<DVec3> = (0..template.len()).map(between).collect();
        let near = Near::new(&model, &between).expect("near");
        let carried = near.skin(&model, (&own, &first.bones), &[]);
        for v in 0..template.len() {
            let want = |bone: usize| -> f32 {
                let both = [v, beside(v)].into_iter().flat_map(|v| first.skin.row(v));
                both.filter(|e| e.0 == bone).map(|e| 0.5 * e.1).sum()
            };
            let sum: f32 = own.row(v).map(|e| want(e.0)).sum();
            for (bone, w) in carried.row(v) {
                assert!((w - want(bone) / sum).abs() < 3e-3, "{v} {bone}: {w}");
            }
        }
        // Bones that the model lacks keep a little.
        model.bones.iter_mut().for_each(|b| b.push('x'));
        assert!(apart(&begun(&model, &plan), &own) < 1e-5);
    }
}
