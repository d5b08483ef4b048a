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
    if place == Place::Cores {
        return Ok(on_cores(Box::new(trainer)));
    }
    let left = match (trainer.plan.relaxed, trainer.wearers[0].layers.is_empty()) {
        _ if trainer.skinning.is_some() => Some("skin weights are learnt on cores alone"),
        (0, true) => None,
        (0, false) => Some("garments over others are learnt together on cores alone"),
        _ => Some("cloth is let go before it is learnt from on cores alone"),
    };
    let tried = match left {
        None => on_device(trainer),
        Some(why) => Err((Box::new(trainer), TrainError::Device(why.into()))),
    };
    match tried {
        Err((_, why)) if place == Place::Cuda => Err(why),
        Err((trainer, _)) => Ok(on_cores(trainer)),
        Ok(placed) => Ok(placed),
    }
}

/// Whether there is a CUDA device that can train, and the program was built for it.
pub fn has_device() -> bool {
    #[cfg(feature = "cuda")]
    return crate::cuda::Device::cuda().is_ok();
    #[cfg(not(feature = "cuda"))]
    false
}

fn on_cores(trainer: Box<Trainer<'_>>) -> Placed<'_> {
    let n = rayon::current_num_threads();
    let cores = if n == 1 { "core" } else { "cores" };
    (trainer, format!("{n} {cores}"))
}

/// The trainer, and why no device takes its steps.
type Left<'a> = (Box<Trainer<'a>>, TrainError);

#[cfg(feature = "cuda")]
fn on_device(trainer: Trainer<'_>) -> Result<Placed<'_>, Left<'_>> {
    match crate::cuda::Device::cuda() {
        Ok(device) => {
            let name = device.name();
            let on = crate::cuda::OnDevice::new(trainer, device)?;
            Ok((Box::new(on), name))
        }
        Err(why) => Err((Box::new(trainer), why.into())),
    }
}

#[cfg(not(feature = "cuda"))]
fn on_device(trainer: Trainer<'_>) -> Result<Placed<'_>, Left<'_>> {
    Err((Box::new(trainer), muslin_model::CrowdError::NotBuilt.into()))
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
