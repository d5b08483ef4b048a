//! Steps by kernels beside a trainer's.

use std::sync::LazyLock;

use super::*;
use crate::cuda::emulated::Emulated;
use crate::testing::{Class, Other, go_on_alike};

static CLASS: LazyLock<Class> = LazyLock::new(Class::new);

/// This machine's processor, and the CUDA device if there is one; nothing where there is no C compiler.
fn devices() -> Vec<Device> {
    let mut out: Vec<Device> = Emulated::new().map(Device::Emulated).into_iter().collect();
    match Device::cuda() {
        Ok(device) => out.push(device),
        Err(why) => println!("skipped on a device: {why}"),
    }
    out
}

/// Trainings of one wearer, and of two.
fn trainings<'a>(other: &'a Other) -> [Trainer<'a>; 2] {
    [CLASS.trainer(), CLASS.taught(other.lessons(&CLASS))]
}

/// The same device once more.
fn again(device: &Device) -> Device {
    match device {
        Device::Emulated(d) => Device::Emulated(d.clone()),
        #[cfg(feature = "cuda")]
        Device::Cuda(_) => Device::cuda().expect("it was there"),
    }
}

fn on<'a>(trainer: Trainer<'a>, device: &Device) -> OnDevice<'a> {
    let on = OnDevice::new(trainer, again(device));
    on.map_err(|e| e.1).expect("there is room")
}

fn bits_of(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}

fn off(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let square = |x: &mut dyn Iterator<Item = f32>| x.map(|x| x * x).sum::<f32>();
    let off = square(&mut a.iter().zip(b).map(|(a, b)| a - b));
    (off / square(&mut b.iter().copied()).max(1e-30)).sqrt()
}

#[test]
fn a_device_learns_what_a_trainer_does() {
    let other = Other::new(&CLASS);
    for device in devices() {
        println!("on {}", device.name());
        for (mut host, mut twin) in trainings(&other).into_iter().zip(trainings(&other)) {
            // Beyond where skin is followed, and the factor is made anew.
            while host.steps() < 3 {
                host.step().expect("finite");
            }
            twin.restore(&host.keep().expect("it tells"))
                .expect("the same training");
            let mut on = on(twin, &device);
            assert_eq!(
                on.keep().expect("it tells"),
                host.keep().expect("it tells"),
                "nothing is learnt by moving"
            );
            for _ in 0..4 {
                let (a, b) = (on.step().expect("finite"), host.step().expect("finite"));
                for ((name, a), (_, b)) in a.energies.terms().iter().zip(b.energies.terms()) {
                    assert!(
                        (a - b).abs() <= 2e-4 * b.abs() + 1e-6,
                        "{name}: {a} for {b}"
                    );
                }
                assert!(
                    (a.under - b.under).abs() < 2e-3,
                    "{} for {}",
                    a.under,
                    b.under
                );
            }
            on.ask().expect("it tells");
            let on = on.host.borrow();
            let (a, b) = (&on.now, &host.now);
            assert_eq!(
                (a.step, a.adam.steps, &a.queue),
                (b.step, b.adam.steps, &b.queue)
            );
            let pairs = [
                ("modes", off(&a.modes, &b.modes)),
                ("momentum", off(&a.momentum, &b.momentum)),
                ("parameters", off(&a.params, &b.params)),
                ("means", off(&a.adam.mean, &b.adam.mean)),
                ("walls", off(a.walls.as_flattened(), b.walls.as_flattened())),
            ];
            println!("{pairs:?}");
            for (what, off) in pairs {
                assert!(off < 5e-3, "{what}: {off}");
            }
        }
    }
}

#[test]
fn a_device_goes_on_to_the_same_bits() {
    for device in devices() {
        let start = || on(CLASS.trainer(), &device);
        let (mut whole, mut broken) = (start(), start());
        while broken.steps() < 2 {
            broken.step().expect("finite");
        }
        let kept = broken.keep().expect("it tells");
        let mut broken = start();
        broken.restore(&kept).expect("the same training");
        go_on_alike([&mut whole, &mut broken], 4);
    }
}

#[test]
fn a_batch_that_is_not_finite_is_left_out_on_a_device_and_said() {
    for device in devices() {
        let mut host = CLASS.trainer();
        // Of one vertex alone, and so that it is there from the first step on.
        host.now.modes[host.plan.codes - 1] = f32::NAN;
        let mut on = on(host, &device);
        let bits = |on: &OnDevice<'_>| bits_of(&on.host.borrow().now.modes);
        let before = bits(&on);
        for _ in 0..5 {
            on.step().expect("left out");
        }
        // What the device has.
        on.is_stale.set(true);
        on.ask().expect("it tells");
        assert_eq!(bits(&on), before);
        let failed = on.step().expect_err("six in a row");
        assert!(
            matches!(
                failed,
                TrainError::NotFinite {
                    step: 6,
                    vertex: 0,
                    ..
                }
            ),
            "{failed}"
        );
    }
}
