//! Where a training's steps are taken.

use crate::{TrainError, Trainer, Training};

/// Where steps are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// On a CUDA device if there is one that can, else on this machine's cores.
    #[default]
    Any,
    /// On the cores, whatever else there is.
    Cores,
    /// On the first CUDA device, or not at all.
    Cuda,
}

/// A training, and where it takes its steps, in words.
pub type Placed<'a> = (Box<dyn Training + 'a>, String);

/// A training that takes its steps there.
///
/// # Errors
/// [`TrainError::Device`] where a CUDA device is asked for and there is none that can, or the program was built without
/// the feature `cuda`.
pub fn placed(trainer: Trainer<'_>, place: Place) -> Result<Placed<'_>, TrainError> {
    let trainer = match on_device(trainer, place) {
        Ok(placed) => return Ok(placed),
        Err((_, why)) if place == Place::Cuda => return Err(why),
        Err((trainer, _)) => trainer,
    };
    let n = rayon::current_num_threads();
    let cores = if n == 1 { "core" } else { "cores" };
    Ok((trainer, format!("{n} {cores}")))
}

/// On a device; else the trainer, and why not.
fn on_device(
    trainer: Trainer<'_>,
    place: Place,
) -> Result<Placed<'_>, (Box<Trainer<'_>>, TrainError)> {
    #[cfg(feature = "cuda")]
    if place != Place::Cores {
        return match crate::cuda::Device::cuda() {
            Ok(device) => {
                let name = device.name();
                let on = crate::cuda::OnDevice::new(trainer, device)?;
                Ok((Box::new(on), name))
            }
            Err(why) => Err((Box::new(trainer), why.into())),
        };
    }
    let _ = place;
    let why = muslin_model::CrowdError::NotBuilt;
    Err((Box::new(trainer), TrainError::from(why)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Class;

    #[test]
    fn steps_are_taken_on_cores_where_no_device_is_asked_for_or_there_is_none() {
        let class = Class::new();
        let (mut cores, said) = placed(class.trainer(), Place::Cores).expect("cores are there");
        assert!(said.ends_with("core") || said.ends_with("cores"), "{said}");
        assert_eq!(cores.step().expect("finite").step, 1);
        let there_is_none = placed(class.trainer(), Place::Cuda).err();
        let (_, any) = placed(class.trainer(), Place::Any).expect("somewhere");
        match there_is_none {
            Some(e) => {
                assert!(matches!(e, TrainError::Device(_)), "{e}");
                assert_eq!(any, said);
            }
            None => assert_ne!(any, said),
        }
    }
}
