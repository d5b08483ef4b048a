//! Who wears the cloth that is learnt: everything about a lesson that no step changes.

use muslin_energy::membrane::Stretch;
use muslin_model::Trait;
use muslin_sim::Material;

use crate::TrainError;
use crate::body::Skinned;
use crate::cut::Cut;
use crate::folds::Folds;
use crate::layers::{Layer, both_ways};
use crate::lesson::{Lesson, Plan};

/// One lesson, ready to be worked on.
pub(crate) struct Wearer<'a> {
    pub lesson: Lesson<'a>,
    pub body: Skinned<'a>,
    pub cut: Cut,
    pub folds: Folds,
    /// Garments of an outfit that lie over others, and under.
    pub layers: Vec<Layer>,
    /// Where the cloth lies at rest [m].
    pub template: Vec<[f32; 3]>,
    /// How stiff each material is in its plane, as it is taught in the end.
    stretch: Vec<Stretch>,
    /// How many times that it is at first.
    firmer: f64,
}

impl<'a> Wearer<'a> {
    pub fn new(lesson: Lesson<'a>, plan: &Plan) -> Result<Self, TrainError> {
        let mut cloth = lesson.cloth.clone();
        for material in &mut cloth.materials {
            soften(&mut material.stretch, plan.stiffest);
        }
        let firmer = |m: &Material| plan.firm / (m.stretch.warp * m.stretch.weft).sqrt();
        Ok(Self {
            firmer: cloth.materials.iter().map(firmer).fold(1.0, f64::max),
            stretch: cloth.materials.iter().map(|m| m.stretch).collect(),
            body: Skinned::new((lesson.avatar, lesson.figure), lesson.template),
            cut: Cut::new(&cloth)?,
            folds: Folds::new(&lesson.cloth.faces, lesson.template, lesson.weights),
            layers: both_ways(lesson.cloth, lesson.template),
            template: lesson.laid(),
            lesson,
        })
    }

    /// How many times as stiff in its plane as in the end the cloth is taken to be, where `firm` falls from 1 at
    /// first to 0.
    pub fn firmness(&self, firm: f64) -> f64 {
        self.firmer.powf(firm)
    }

    /// How stiff face `f` is in its plane, as it is taught in the end.
    pub fn stretch(&self, f: usize) -> Stretch {
        self.stretch[self.lesson.cloth.material_of[f] as usize]
    }
}

/// Warp, weft and shear by the same share, so that the geometric mean of the first two is `stiffest` [N/m]
/// at most.
fn soften(k: &mut Stretch, stiffest: f64) {
    let share = (stiffest / (k.warp * k.weft).sqrt()).min(1.0);
    for k in [&mut k.warp, &mut k.weft, &mut k.shear] {
        *k *= share;
    }
}

/// All lessons, if they are of one cloth on one family of bodies and tell the same traits.
pub(crate) fn wearers<'a>(
    lessons: Vec<Lesson<'a>>,
    plan: &Plan,
) -> Result<Vec<Wearer<'a>>, TrainError> {
    of_one_cloth(&lessons)?;
    let one = |l| Wearer::new(l, plan);
    lessons.into_iter().map(one).collect()
}

/// The first lesson, if all are of one cloth on one family of bodies and tell the same traits.
pub(crate) fn of_one_cloth<'l, 'a>(
    lessons: &'l [Lesson<'a>],
) -> Result<&'l Lesson<'a>, TrainError> {
    let Some(first) = lessons.first() else {
        return Err(TrainError::OtherCloth("there is none"));
    };
    for l in lessons {
        let same = [
            ("triangles", l.cloth.faces == first.cloth.faces),
            ("pins", l.cloth.pins == first.cloth.pins),
            ("skin weights", l.weights == first.weights),
            (
                "traits",
                l.traits
                    .iter()
                    .map(|t| t.0)
                    .eq(first.traits.iter().map(|t| t.0)),
            ),
        ];
        if let Some((what, _)) = same.into_iter().find(|s| !s.1) {
            return Err(TrainError::OtherCloth(what));
        }
    }
    Ok(first)
}

/// What the network is told, as the first lesson says and from the least to the most of all.
pub(crate) fn traits(lessons: &[Lesson<'_>]) -> Vec<Trait> {
    let of = |k: usize| {
        lessons
            .iter()
            .filter_map(move |l| Some(l.traits.get(k)?.1 as f32))
    };
    let one = |(k, (name, value)): (usize, &(&str, f64))| Trait {
        name: (*name).into(),
        value: *value as f32,
        range: [
            of(k).fold(f32::INFINITY, f32::min),
            of(k).fold(f32::NEG_INFINITY, f32::max),
        ],
    };
    let first = lessons.first().map_or(&[][..], |l| l.traits);
    first.iter().enumerate().map(one).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use crate::testing::Class;

    static CLASS: LazyLock<Class> = LazyLock::new(Class::new);

    #[test]
    fn soft_cloth_is_firm_at_first_and_itself_in_the_end() {
        let mut trainer = CLASS.trainer();
        let wearer = &trainer.wearers[0];
        let own = wearer.stretch(0);
        let own = (own.warp * own.weft).sqrt();
        let firm = trainer.plan.firm;
        assert!(own < 0.5 * firm, "{own}");
        assert!((wearer.firmness(1.0) * own / firm - 1.0).abs() < 1e-9);
        let firmness = wearer.firmness(1.0);
        let steps = trainer.plan.steps;
        let mut pack = trainer.now.packs[0].clone();
        let mut cost = |step: u64| {
            trainer.now.step = step;
            trainer.work(&mut pack).energies
        };
        let [first, midway, last] = [0, steps / 5, steps].map(&mut cost);
        assert!((first.membrane / last.membrane / firmness - 1.0).abs() < 1e-4);
        assert!(last.membrane < midway.membrane && midway.membrane < first.membrane);
        assert_eq!((first.bend, first.weight), (last.bend, last.weight));
    }
}
