//! Who wears the cloth that a published system learns: everything that no step changes.

use muslin_model::{Encoder, Stream, Trait};

use super::sheet::Sheet;
use super::trainer::Course;
use crate::TrainError;
use crate::body::Skinned;
use crate::layers::{Layer, layers};
use crate::lesson::Lesson;

/// One lesson, ready to be worked on.
pub(crate) struct Wearer<'a> {
    pub lesson: Lesson<'a>,
    pub body: Skinned<'a>,
    pub sheet: Sheet,
    /// The garments that are worn over others.
    pub layers: Vec<Layer>,
    /// Where the cloth lies at rest [m].
    pub template: Vec<[f32; 3]>,
    /// What reads the body's poses, and what SNUG is told of it.
    pub stream: Stream,
}

impl<'a> Wearer<'a> {
    /// `traits` are those of the first lesson, with the ranges of all; `drivers` the bones that are read.
    pub fn new(
        lesson: Lesson<'a>,
        course: &Course,
        (encoder, traits, drivers): (&Encoder, &[Trait], &[String]),
    ) -> Result<Self, TrainError> {
        let mut encoder = encoder.clone();
        if let Encoder::Snug(s) = &mut encoder {
            let own = traits.iter().zip(lesson.traits);
            s.body = own.map(|(t, (_, x))| t.level_of(*x as f32)).collect();
        }
        let mut stream = Stream::new(&encoder, drivers, lesson.avatar)?;
        stream.begin(1.0 / course.fps);
        Ok(Self {
            body: Skinned::new((lesson.avatar, lesson.figure), lesson.template),
            sheet: Sheet::new(&course.recipe(), lesson.cloth, lesson.template)?,
            layers: layers(lesson.cloth, lesson.template),
            template: lesson.laid(),
            lesson,
            stream,
        })
    }
}
