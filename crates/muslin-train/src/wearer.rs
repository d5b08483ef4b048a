//! Who wears the cloth that is learnt: everything about a lesson that no step changes.

use muslin_energy::membrane::Stretch;

use crate::TrainError;
use crate::body::Skinned;
use crate::cut::Cut;
use crate::folds::Folds;
use crate::lesson::Lesson;

/// One lesson, ready to be worked on.
pub(crate) struct Wearer<'a> {
    pub lesson: Lesson<'a>,
    pub body: Skinned<'a>,
    pub cut: Cut,
    pub folds: Folds,
    /// Where the cloth lies at rest [m].
    pub template: Vec<[f32; 3]>,
    /// How stiff each material is in its plane, as it is taught.
    stretch: Vec<Stretch>,
}

impl<'a> Wearer<'a> {
    pub fn new(lesson: Lesson<'a>, stiffest: f64) -> Result<Self, TrainError> {
        let mut cloth = lesson.cloth.clone();
        for material in &mut cloth.materials {
            soften(&mut material.stretch, stiffest);
        }
        Ok(Self {
            stretch: cloth.materials.iter().map(|m| m.stretch).collect(),
            body: Skinned::new((lesson.avatar, lesson.figure), lesson.template),
            cut: Cut::new(&cloth)?,
            folds: Folds::new(&lesson.cloth.faces, lesson.template, lesson.weights),
            template: (lesson.template.iter())
                .map(|p| p.as_vec3().to_array())
                .collect(),
            lesson,
        })
    }

    /// How stiff face `f` is in its plane, as it is taught.
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
pub(crate) fn wearers(
    lessons: Vec<Lesson<'_>>,
    stiffest: f64,
) -> Result<Vec<Wearer<'_>>, TrainError> {
    let Some(first) = lessons.first().copied() else {
        return Err(TrainError::OtherCloth("there is none"));
    };
    for l in &lessons {
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
    let one = |l| Wearer::new(l, stiffest);
    lessons.into_iter().map(one).collect()
}
