//! Whole steps of the three systems on a coarse shirt.

use std::sync::LazyLock;

use glam::DVec3;
use muslin_body::{Figure, Motion};
use muslin_model::Model;
use muslin_net::learn::Noise;

use super::clips::{Batch, Frame};
use super::net::Chance;
use super::work::Work;
use super::{Course, Published, StretchLaw, System};
use crate::Training;
use crate::lanes::Row;
use crate::testing::{Class, HEAVY, Other, go_on_alike};

static CLASS: LazyLock<Class> = LazyLock::new(Class::new);
const ALL: [System; 3] = [System::Pbns, System::Snug, System::Ncs];

/// A trainer of a short piece of the wave.
fn trainer(course: Course) -> Published<'static> {
    taught(&CLASS, course)
}

fn taught(class: &'static Class, course: Course) -> Published<'static> {
    let motion = Motion {
        fps: 25.0,
        poses: class.poses[10..27].to_vec(),
    };
    let course = Course {
        fps: 25.0,
        ..course
    };
    Published::new(vec![class.lesson()], course, vec![motion]).expect("enough poses")
}

/// A batch, and chance that changes nothing.
fn batch(trainer: &Published) -> Batch {
    let ends = std::array::from_fn(|lane| trainer.clips.windows[(7 * lane) % 17]);
    trainer
        .watched(0, &Chance::default())
        .batch(&trainer.clips, ends)
}

fn work(trainer: &Published, batch: &Batch, chance: &Chance) -> Work {
    trainer.work((&trainer.clips, batch), chance)
}

/// A trainer that has taken `steps` small steps.
fn after(steps: usize, system: System) -> Published<'static> {
    let mut trainer = trainer(Course {
        rate: 2e-4,
        ..Course::of(system)
    });
    for _ in 0..steps {
        trainer.step().expect("finite");
    }
    trainer
}

/// The slope along the gradient within `span` of the parameters, by central differences, over what
/// the gradient says.
fn ratio(trainer: &mut Published, batch: &Batch, span: std::ops::Range<usize>) -> f64 {
    let chance = Chance::default();
    let slopes = work(trainer, batch, &chance).slopes;
    let gradient = &slopes[span.clone()];
    let norm = gradient
        .iter()
        .map(|g| f64::from(*g).powi(2))
        .sum::<f64>()
        .sqrt();
    let step = 2e-3 / norm;
    let old = trainer.now.params.clone();
    let mut at = |sign: f64| {
        let moved = trainer.now.params[span.clone()].iter_mut().zip(gradient);
        moved.for_each(|(p, g)| *p += (sign * step * f64::from(*g)) as f32);
        trainer.bind();
        let cost = work(trainer, batch, &chance).energies.total();
        trainer.now.params.clone_from(&old);
        trainer.bind();
        cost
    };
    (at(1.0) - at(-1.0)) / (2.0 * step * norm * norm)
}

#[test]
fn the_gradients_are_those_of_the_cost_in_the_network_and_in_the_shapes() {
    for system in ALL {
        let mut trainer = after(3, system);
        trainer.wearers[0].sheet.pins = vec![3, 7];
        // Without mass: inertia takes the poses before as they are, and is asked on its own below.
        trainer.wearers[0].sheet.mass.fill(0.0);
        let batch = batch(&trainer);
        let (n, all) = (trainer.encoder.n_params(), trainer.now.params.len());
        for span in [0..n, n..all] {
            let ratio = ratio(&mut trainer, &batch, span.clone());
            assert!((ratio - 1.0).abs() < 0.03, "{system:?} {span:?}: {ratio}");
        }
    }
}

#[test]
fn skin_weights_that_are_learnt_have_the_slopes_of_the_cost_and_play_and_go_on_as_the_rest() {
    for system in [System::Pbns, System::Ncs] {
        let binding = || {
            let mut trainer = trainer(Course {
                rate: 2e-4,
                skinning: true,
                ..Course::of(system)
            });
            trainer.wearers[0].sheet.pins = vec![3, 7];
            trainer
        };
        let (mut first, mut again) = (binding(), binding());
        let before = first.skin.clone();
        for _ in 0..2 {
            first.step().expect("finite");
        }
        assert!(first.skin != before, "{system:?} learns them");
        again
            .restore(&first.keep().expect("on cores"))
            .expect("of the same training");
        assert!(again.skin == first.skin);
        go_on_alike([&mut first, &mut again], 3);
        let model = first.model(Default::default()).expect("on cores");
        assert_eq!(model.check(), Ok(()));
        plays_as_learnt(&first, &model, (0, &CLASS.figure));
        first.wearers[0].sheet.mass.fill(0.0);
        let batch = batch(&first);
        let [network, shapes, bound] = first.parts().map(<[f32]>::len);
        for span in [
            network..network + shapes,
            network + shapes..network + shapes + bound,
        ] {
            let ratio = ratio(&mut first, &batch, span.clone());
            assert!((ratio - 1.0).abs() < 0.03, "{system:?} {span:?}: {ratio}");
        }
    }
}

#[test]
fn ncs_resists_stretch_by_the_law_that_is_asked_for() {
    let cost = |stretch| {
        let trainer = trainer(Course {
            stretch,
            ..Course::of(System::Ncs)
        });
        let batch = batch(&trainer);
        work(&trainer, &batch, &Chance::default()).energies.membrane
    };
    let [springs, stvk, yarns] = [
        StretchLaw::MassSpring,
        StretchLaw::StVk,
        StretchLaw::BaraffWitkin,
    ]
    .map(cost);
    assert!(springs != stvk && stvk != yarns && yarns != springs);
    assert!([springs, stvk, yarns].iter().all(|e| *e > 0.0));
}

#[test]
fn every_part_of_the_moving_encoder_has_the_slopes_of_the_cost() {
    let mut trainer = after(3, System::Ncs);
    trainer.wearers[0].sheet.mass.fill(0.0);
    let batch = batch(&trainer);
    let muslin_model::Encoder::Ncs(net) = trainer.encoder.clone() else {
        panic!("a network of NCS")
    };
    let mut start = 0;
    for (part, end) in net.ends().into_iter().enumerate() {
        let ratio = ratio(&mut trainer, &batch, start..end);
        assert!((ratio - 1.0).abs() < 0.05, "part {part}: {ratio}");
        start = end;
    }
}

#[test]
fn weight_and_inertia_pull_as_their_energies_say_with_the_past_as_it_is() {
    let mut trainer = after(3, System::Snug);
    trainer.wearers[0].sheet.patches.clear();
    trainer.wearers[0].sheet.hinges.clear();
    let batch = batch(&trainer);
    let first = work(&trainer, &batch, &Chance::default());
    assert!(first.energies.inertia > 1e-6, "{:?}", first.energies);
    // The constant shape moves all poses alike: of inertia it feels the last pose's part alone.
    let codes = trainer.encoder.n_codes() + 1;
    let v = 40;
    let rows = trainer.encoder.n_params() + 3 * v * codes;
    let felt = |w: &Work| {
        let entry = |axis: usize| f64::from(w.slopes[rows + axis * codes + codes - 1]);
        DVec3::new(entry(0), entry(1), entry(2))
    };
    let masses = std::mem::take(&mut trainer.wearers[0].sheet.mass);
    trainer.wearers[0].sheet.mass = vec![0.0; masses.len()];
    let own = felt(&first) - felt(&work(&trainer, &batch, &Chance::default()));
    let (mass, rate) = (f64::from(masses[v]), 25.0 * 25.0);
    let places = trainer.positions(&batch, &Chance::default());
    let mut want = DVec3::ZERO;
    for lane in 0..16 {
        let x = [0, 1, 2].map(|f| place(&places, (f, lane), v));
        let root = DVec3::from_array(batch.root.map(|r| f64::from(r[lane])));
        let change = x[2] - 2.0 * x[1] + x[0] + root;
        for f in 0..3 {
            let inertia = if f == 2 {
                change * (mass * rate / 16.0)
            } else {
                DVec3::ZERO
            };
            let weight = DVec3::Y * (mass * 9.81 / 48.0);
            let frame = (&batch.frames[f], lane);
            want += turned_back(&trainer, frame, v, inertia + weight);
        }
    }
    assert!(own.distance(want) < 2e-3 * mass, "{own} against {want}");
}

#[test]
fn from_samples_whose_motions_change_places_the_decoder_alone_learns() {
    let trainer = after(2, System::Ncs);
    let batch = batch(&trainer);
    let chance = Chance {
        order: (1..16).chain([0]).collect(),
        ..Chance::default()
    };
    let mixed = work(&trainer, &batch, &chance);
    let plain = work(&trainer, &batch, &Chance::default());
    let muslin_model::Encoder::Ncs(net) = &trainer.encoder else {
        panic!("a network of NCS")
    };
    let [.., encoders, _] = net.ends();
    let moves = |w: &Work, span: std::ops::Range<usize>| w.slopes[span].iter().any(|g| *g != 0.0);
    assert!(!moves(&mixed, 0..encoders) && moves(&plain, 0..encoders));
    assert!(moves(&mixed, encoders..trainer.encoder.n_params()));
    assert_eq!(mixed.energies.inertia, 0.0);
    assert!(plain.energies.inertia > 0.0);
    assert!(mixed.energies.membrane != plain.energies.membrane);
}

#[test]
fn without_gravity_turns_and_accelerations_alone_are_heard_in_codes_of_any_size() {
    let mut trainer = trainer(Course {
        gravity: false,
        width: 48,
        ..Course::of(System::Ncs)
    });
    for _ in 0..2 {
        trainer.step().expect("finite");
    }
    assert_eq!(trainer.encoder.n_codes(), 48);
    let mut batch = batch(&trainer);
    let places = |b: &Batch| trainer.positions(b, &Chance::default());
    let before = places(&batch);
    // The root's gravity, and that of the second joint, then its first turn.
    let root = batch.told[0].len().min(16);
    batch.told.iter_mut().for_each(|t| t[..root].fill(9.0));
    batch
        .told
        .iter_mut()
        .for_each(|t| t[9 * 16..12 * 16].fill(9.0));
    assert!(places(&batch) == before);
    batch
        .told
        .iter_mut()
        .for_each(|t| t[3 * 16..4 * 16].fill(9.0));
    assert!(places(&batch) != before);
    plays_as_learnt(
        &trainer,
        &trainer.model(Default::default()).expect("on cores"),
        (0, &CLASS.figure),
    );
}

#[test]
fn a_few_steps_lower_what_a_motion_costs_and_the_model_is_whole() {
    for (system, steps) in [(System::Pbns, 14), (System::Snug, 8), (System::Ncs, 8)] {
        let rate = if system == System::Snug { 1e-4 } else { 1e-3 };
        let mut trainer = trainer(Course {
            rate,
            ..Course::of(system)
        });
        let batch = batch(&trainer);
        let costs = |t: &Published| work(t, &batch, &Chance::default()).energies.membrane;
        let first = costs(&trainer);
        for _ in 0..steps {
            trainer.step().expect("finite");
        }
        let last = costs(&trainer);
        assert!(last < 0.8 * first, "{system:?}: {first} {last}");
        let told = trainer.judge(&trainer.clips.motions[0]).expect("on cores");
        let other = told.energies.membrane;
        assert!(
            other > 0.5 * last && other < 2.0 * last,
            "{system:?}: {told:?}"
        );
        let model = trainer.model(Default::default()).expect("on cores");
        assert_eq!(model.check(), Ok(()));
        assert_eq!(model.encoder.name(), system.name());
        assert_eq!(model.encoder.is_moving(), system.is_moving());
    }
}

#[test]
fn a_skin_is_made_once_however_many_ask_for_it() {
    let trainer = trainer(Course::of(System::Pbns));
    let places = [[0, 3], [0, 5], [0, 3]];
    let first = trainer.clips.skins((0, &trainer.wearers[0].body), &places);
    let again = trainer
        .clips
        .skins((0, &trainer.wearers[0].body), &[[0, 5], [0, 6]]);
    assert!(std::sync::Arc::ptr_eq(&first[0], &first[2]));
    assert!(std::sync::Arc::ptr_eq(&first[1], &again[0]));
    for (skin, pose) in first.iter().chain(&again).zip([3, 5, 3, 5, 6]) {
        let want = trainer.wearers[0]
            .body
            .skin(&trainer.clips.motions[0].poses[pose]);
        assert!(skin.verts == want.verts && skin.normals == want.normals);
    }
}

#[test]
fn a_resumed_training_gives_the_bits_of_an_unbroken_one_on_any_number_of_threads() {
    for system in ALL {
        let run = |threads: usize, stop: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("threads").install(|| {
                let mut first = trainer(Course::of(system));
                while first.steps() < stop {
                    first.step().expect("finite");
                }
                let mut again = trainer(Course::of(system));
                again
                    .restore(&first.keep().expect("on cores"))
                    .expect("of the same training");
                while again.steps() < 3 {
                    again.step().expect("finite");
                }
                again.keep().expect("on cores")
            })
        };
        let whole = run(1, 3);
        assert!(run(3, 1) == whole, "{system:?}");
        let mut other = trainer(Course {
            seed: 2,
            ..Course::of(system)
        });
        assert!(other.restore(&whole).is_err());
    }
}

#[test]
fn what_is_not_a_number_is_skipped_a_few_times_and_then_named() {
    let mut trainer = after(1, System::Pbns);
    let at = trainer.encoder.n_params() + 5 * 3 * 32;
    trainer.now.params[at..at + 32].fill(f32::NAN);
    let before = trainer.now.adam.clone();
    let faults: Vec<bool> = (0..6).map(|_| trainer.step().is_err()).collect();
    assert_eq!(faults, [false, false, false, false, false, true]);
    assert!(
        trainer.now.adam == before,
        "nothing is learnt from such a batch"
    );
    let fault = trainer.step().expect_err("it stays so").to_string();
    assert!(fault.contains("vertex 5"), "{fault}");
}

#[test]
fn what_is_played_is_what_was_learnt() {
    for system in ALL {
        let trainer = after(2, system);
        let model = trainer.model(Default::default()).expect("on cores");
        plays_as_learnt(&trainer, &model, (0, &CLASS.figure));
    }
}

/// From the first pose of the clip, so that windows and stream know the same past.
fn plays_as_learnt(trainer: &Published, model: &Model, (wearer, figure): (usize, &Figure)) {
    let mut player = muslin_model::Player::new(model, &CLASS.avatar).expect("its bones");
    player.begin(1.0 / 25.0);
    let poses = &trainer.clips.motions[0].poses[..3];
    let mut out = vec![[0.0; 3]; model.n_verts()];
    for pose in poses {
        let bones = CLASS.avatar.bones(figure, pose);
        player.frame(pose, &bones, &mut out);
    }
    let batch = trainer
        .watched(wearer, &Chance::default())
        .batch(&trainer.clips, [[0, 2]; 16]);
    let last = batch.frames.len() - 1;
    let places = trainer.positions(&batch, &Chance::default());
    for (v, got) in out.iter().enumerate() {
        let got = DVec3::from_array(got.map(f64::from)) - poses[2].root;
        let want = place(&places, (last, 0), v);
        let system = trainer.course.system;
        assert!(got.distance(want) < 5e-5, "{system:?} {v}: {got} {want}");
    }
}

#[test]
fn the_recurrent_system_is_told_who_wears_it_and_plays_on_each_of_them() {
    let other = Other::new(&CLASS);
    let new = || {
        let course = Course {
            fps: 25.0,
            rate: 2e-4,
            ..Course::of(System::Snug)
        };
        Published::new(other.lessons(&CLASS), course, vec![CLASS.wave()]).expect("enough poses")
    };
    let mut trainer = new();
    let told = |w: usize| {
        let watched = trainer.watched(w, &Chance::default());
        watched.batch(&trainer.clips, [[0, 5]; 16]).told[0][..32].to_vec()
    };
    assert!(told(0).iter().all(|x| *x == -1.0) && told(1).iter().all(|x| *x == 1.0));
    while trainer.steps() < 2 {
        trainer.step().expect("finite");
    }
    let mut again = new();
    again
        .restore(&trainer.keep().expect("on cores"))
        .expect("of the same training");
    go_on_alike([&mut trainer, &mut again], 4);
    let model = trainer.model(Default::default()).expect("on cores");
    assert_eq!(model.check(), Ok(()));
    let mut there = model.told(|name| Some(HEAVY.iter().find(|t| t.0 == name)?.1));
    there.template = trainer.wearers[1].template.clone();
    plays_as_learnt(&trainer, &there, (1, &other.figure));
}

/// Where a vertex is in one decoded pose of one window [m].
fn place(x: &[Vec<Row>], (frame, lane): (usize, usize), v: usize) -> DVec3 {
    let row = |axis: usize| f64::from(x[frame][3 * v + axis][lane]);
    DVec3::new(row(0), row(1), row(2))
}

/// A force on it in the rest frame.
fn turned_back(trainer: &Published, (frame, lane): (&Frame, usize), v: usize, f: DVec3) -> DVec3 {
    let one = |(b, w): (usize, f32)| {
        let a = frame.bones[b].map(|row| f64::from(row[lane]));
        glam::DMat3::from_cols_slice(&a[..9]).transpose() * f * f64::from(w)
    };
    trainer.skin.row(v).map(one).sum()
}

static OUTFIT: LazyLock<Class> = LazyLock::new(Class::outfit);

#[test]
fn layers_push_each_other_as_their_cost_says_and_no_force_is_lost() {
    let mut trainer = taught(
        &OUTFIT,
        Course {
            rate: 2e-4,
            ..Course::of(System::Pbns)
        },
    );
    trainer.step().expect("finite");
    let sheet = &mut trainer.wearers[0].sheet;
    sheet.mass.fill(0.0);
    sheet.edges.clear();
    sheet.hinges.clear();
    sheet.pins.clear();
    let batch = batch(&trainer);
    let all = trainer.now.params.len();
    let shapes = trainer.encoder.n_params()..all;
    let both = ratio(&mut trainer, &batch, shapes.clone());
    assert!((both - 1.0).abs() < 0.02, "{both}");
    // The inner shirt alone: what it feels of the outer one is part of the cost's slope as well.
    let inner = shapes.start..shapes.start + shapes.len() / 2;
    let felt = ratio(&mut trainer, &batch, inner.clone());
    assert!((felt - 1.0).abs() < 0.02, "{felt}");
    let with = work(&trainer, &batch, &Chance::default());
    let layers = std::mem::take(&mut trainer.wearers[0].layers);
    let without = work(&trainer, &batch, &Chance::default());
    assert_eq!(layers.len(), 1);
    assert!(with.energies.contact > 2.0 * without.energies.contact);
    assert!(with.slopes[inner.clone()] != without.slopes[inner.clone()]);
    // Where the outer shirt does not push, the inner one does not feel it, which costs as much.
    trainer.wearers[0].layers = layers;
    trainer.course.one_way = true;
    let one_way = work(&trainer, &batch, &Chance::default());
    assert_eq!(one_way.energies.contact, with.energies.contact);
    assert!(one_way.slopes[inner.clone()] == without.slopes[inner]);
}

#[test]
fn an_outer_shirt_learns_to_lie_outside() {
    let mut trainer = taught(&OUTFIT, Course::of(System::Pbns));
    let batch = batch(&trainer);
    let cost = |t: &Published| work(t, &batch, &Chance::default()).energies.contact;
    let first = cost(&trainer);
    for _ in 0..20 {
        trainer.step().expect("finite");
    }
    let last = cost(&trainer);
    assert!(last < 0.5 * first, "{first} {last}");
    let model = trainer.model(Default::default()).expect("on cores");
    let (n, faces) = (model.n_verts() / 2, model.faces.len() / 2);
    let parts = [
        model.garment(0..n, 0..faces),
        model.garment(n..2 * n, faces..2 * faces),
    ];
    let mut player = |m: &Model| {
        assert_eq!(m.check(), Ok(()));
        let mut player = muslin_model::Player::new(m, &OUTFIT.avatar).expect("its bones");
        let mut out = vec![[0.0; 3]; m.n_verts()];
        let pose = &trainer.clips.motions[0].poses[3];
        let bones = OUTFIT.avatar.bones(&OUTFIT.figure, pose);
        player.frame(pose, &bones, &mut out);
        out
    };
    let (whole, apart) = (player(&model), parts.each_ref().map(&mut player).concat());
    for (a, b) in whole.iter().zip(&apart) {
        let off = (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
        assert!(off < 2e-5, "{a:?} {b:?}");
    }
}

/// The shirt on the usual body and on a heavier one, of which a resizer is told.
static OTHER: LazyLock<Other> = LazyLock::new(|| Other::new(&CLASS));

fn resizing() -> Published<'static> {
    let course = Course {
        fps: 25.0,
        ..Course::of(System::Pbns)
    };
    Published::new(OTHER.lessons(&CLASS), course, vec![CLASS.wave()]).expect("enough poses")
}

#[test]
fn a_resizer_has_the_slopes_of_what_its_wearers_cost_at_rest() {
    let mut trainer = resizing();
    // Shapes that weigh something.
    let n = trainer.now.resized.params.len() - 32 * 3 * CLASS.template.len();
    let shapes = &mut trainer.now.resized.params[n..];
    let noise = Noise::new(4).normals(shapes.len());
    shapes
        .iter_mut()
        .zip(noise)
        .for_each(|(p, x)| *p = 5e-4 * x);
    let resizing = trainer.resizing.as_ref().expect("there is one");
    let chosen = std::array::from_fn(|lane| lane % 2);
    let of = |p: &[f32]| {
        resizing
            .slopes(p, (&trainer.wearers, &chosen))
            .expect("finite")
    };
    let params = &trainer.now.resized.params;
    let slopes = of(params).1;
    for span in [0..n, n..params.len()] {
        let gradient = &slopes[span.clone()];
        let square: f64 = gradient.iter().map(|g| f64::from(*g).powi(2)).sum();
        let step = 2e-3 / square.sqrt();
        let at = |sign: f64| {
            let mut moved = params.clone();
            let pairs = moved[span.clone()].iter_mut().zip(gradient);
            pairs.for_each(|(p, g)| *p += (sign * step * f64::from(*g)) as f32);
            of(&moved).0
        };
        let ratio = (at(1.0) - at(-1.0)) / (2.0 * step * square);
        assert!((ratio - 1.0).abs() < 0.03, "{span:?}: {ratio}");
    }
}

#[test]
fn a_resizer_learns_to_lay_the_cloth_on_every_wearer_and_goes_on_to_the_same_bits() {
    let mut trainer = resizing();
    let chosen = std::array::from_fn(|lane| lane % 2);
    let cost = |t: &Published| {
        let all = (t.wearers.as_slice(), &chosen);
        let of = |r: &super::resizer::Resizing| r.slopes(&t.now.resized.params, all);
        t.resizing
            .as_ref()
            .map(of)
            .expect("there is one")
            .expect("finite")
            .0
    };
    // What is cut for somebody hangs on them; what is cut a tenth too wide does not.
    let edges = &mut trainer.wearers[1].sheet.edges;
    edges.iter_mut().for_each(|e| e.rest *= 1.1);
    let first = cost(&trainer);
    for _ in 0..60 {
        let own = trainer.resizing.as_ref().expect("there is one");
        let (now, all) = (&mut trainer.now.resized, &trainer.wearers);
        own.step(now, (all, &chosen)).expect("finite");
    }
    let last = cost(&trainer);
    assert!(last < first - 0.02, "{first} {last}");
    while trainer.steps() < 2 {
        trainer.step().expect("finite");
    }
    let mut again = resizing();
    again
        .restore(&trainer.keep().expect("on cores"))
        .expect("of the same training");
    let edges = &mut again.wearers[1].sheet.edges;
    edges.iter_mut().for_each(|e| e.rest *= 1.1);
    go_on_alike([&mut trainer, &mut again], 3);
    // Played on either of them it lies where it was learnt to.
    let model = trainer.model(Default::default()).expect("on cores");
    assert_eq!(model.check(), Ok(()));
    let read = Model::from_weights(&model.to_weights()).expect("a whole file");
    assert_eq!(read.traits, model.traits);
    plays_as_learnt(&trainer, &model, (0, &CLASS.figure));
    let mut there = model.told(|name| Some(HEAVY.iter().find(|t| t.0 == name)?.1));
    there.template = trainer.wearers[1].template.clone();
    let laid = trainer.laid(1);
    let off = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f32::max);
    let most = |a: &[[f32; 3]]| {
        a.iter()
            .zip(laid.iter())
            .map(|(a, b)| off(a, b))
            .fold(0.0, f32::max)
    };
    assert!(most(&there.laid()) < 1e-6);
    assert!(most(&there.template) > 1e-4);
    let mut stored = read.told(|name| Some(HEAVY.iter().find(|t| t.0 == name)?.1));
    stored.template = there.template;
    assert!(most(&stored.laid()) < 1e-5);
    // Poses are learnt by the first alone.
    assert_eq!(trainer.wearer(), 0);
}
