//! A model as it is played and as it is stored.

use glam::{DMat3, DVec3};
use muslin_body::{Avatar, Pose, Shape, motions};
use muslin_model::{Encoder, Model, Player, Precision, Reader, Skin, Trait};
use muslin_net::Numbers;
use muslin_net::learn::{Mlp, Noise, Nonlinear};

/// Random cloth of 37 vertices on three bones.
fn model() -> Model {
    let mut noise = Noise::new(11);
    let n = 37;
    let drivers: Vec<String> = ["root", "spine03", "upperarm01.L"]
        .map(str::to_owned)
        .into();
    let inputs = Reader::n_inputs_of(drivers.len());
    let encoder = Mlp {
        widths: vec![inputs, 10, 6],
        bend: Nonlinear::Silu,
        bias: true,
    };
    let mut skin = Skin {
        starts: vec![0],
        ..Skin::default()
    };
    for v in 0..n {
        let w = noise.unit() as f32;
        skin.bones.extend([(v % 3) as u8, ((v + 1) % 3) as u8]);
        skin.weights.extend([w, 1.0 - w]);
        skin.starts.push(skin.bones.len() as u32);
    }
    Model {
        notes: [("garment".to_owned(), "tee".to_owned())].into(),
        faces: (0..n as u32 - 2).map(|i| [i, i + 1, i + 2]).collect(),
        template: (0..n)
            .map(|_| std::array::from_fn(|_| noise.normal() as f32))
            .collect(),
        bones: ["spine03", "upperarm01.L", "upperarm01.R"]
            .map(str::to_owned)
            .into(),
        skin,
        drivers,
        scale: vec![[0.1, 1.3]; inputs],
        params: encoder.start(&mut noise),
        encoder: Encoder::Plain(encoder),
        modes: noise.normals(3 * n * 7).iter().map(|x| 0.02 * x).collect(),
        traits: Vec::new(),
        sway: None,
        resizer: None,
    }
}

/// The same cloth with a network that is told two traits.
fn told() -> Model {
    let plain = model();
    let mut noise = Noise::new(5);
    let encoder = Mlp {
        widths: vec![plain.scale.len() + 2, 10, 6],
        bend: Nonlinear::Silu,
        bias: true,
    };
    let one = |name: &str, value| Trait {
        name: name.into(),
        value,
        range: [-1.0, 2.0],
    };
    Model {
        traits: vec![one("ln_bend", 0.25), one("waist", 0.75)],
        scale: vec![[0.1, 1.3]; plain.scale.len() + 2],
        params: encoder.start(&mut noise),
        encoder: Encoder::Plain(encoder),
        ..plain
    }
}

#[test]
fn a_frame_is_the_formula_written_out_in_double_precision() {
    is_the_formula(&model());
    let usual = told();
    is_the_formula(&usual);
    let other = usual.clone().told(|name| (name == "waist").then_some(-0.5));
    assert_eq!((other.traits[0].value, other.traits[1].value), (0.25, -0.5));
    is_the_formula(&other);
    assert_ne!(frame(&usual), frame(&other));
    let beyond = usual.told(|_| Some(9.0));
    assert!(beyond.traits.iter().all(|t| t.value == 2.0));
}

/// The cloth in a pose of the wave.
fn frame(model: &Model) -> Vec<[f32; 3]> {
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let pose = wave(&avatar, 9);
    let mut out = vec![[0.0f32; 3]; model.n_verts()];
    let mut player = Player::new(model, &avatar).expect("the bones are there");
    player.frame(&pose, &avatar.bones(&figure, &pose), &mut out);
    out
}

fn is_the_formula(model: &Model) {
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let pose = wave(&avatar, 9);
    let bones = avatar.bones(&figure, &pose);
    let mut player = Player::new(model, &avatar).expect("the bones are there");
    let mut out = vec![[0.0f32; 3]; model.n_verts()];
    player.frame(&pose, &bones, &mut out);
    let z = codes(model, &avatar, &pose);
    for (v, out) in out.iter().enumerate() {
        let d = |c: usize| {
            (0..7)
                .map(|k| f64::from(model.modes[(3 * v + c) * 7 + k]) * z[k])
                .sum::<f64>()
        };
        let p = DVec3::new(d(0), d(1), d(2)) + DVec3::from_array(model.template[v].map(f64::from));
        let mut x = DVec3::ZERO;
        for (b, w) in model.skin.row(v) {
            let bone = avatar.bone(&model.bones[b]).expect("a bone");
            x += bones[bone].transform_point3(p) * f64::from(w);
        }
        let got = DVec3::from_array(out.map(f64::from));
        assert!(got.distance(x) < 1e-5, "{v}: {got} against {x}");
    }
    let mut again = vec![[0.0f32; 3]; model.n_verts()];
    player.frame(&wave(&avatar, 3), &bones, &mut again);
    player.frame(&pose, &bones, &mut again);
    assert_eq!(again, out, "nothing is left of the frame before");
}

fn wave(avatar: &Avatar, frame: usize) -> Pose {
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    motions::make(avatar, &figure, "wave", 10.0)
        .expect("a built-in motion")
        .poses[frame]
        .clone()
}

/// The network in plain loops.
fn codes(model: &Model, avatar: &Avatar, pose: &Pose) -> Vec<f64> {
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let reader = Reader::new(avatar, &model.drivers).expect("the bones are there");
    let mut told = vec![0.0; reader.n_inputs()];
    reader.read(pose, &avatar.bones(&figure, pose), &mut told);
    let traits = model.traits.iter().map(|t| t.value);
    let mut x: Vec<f64> = told
        .into_iter()
        .chain(traits)
        .map(|x| (f64::from(x) - f64::from(0.1f32)) * f64::from(1.3f32))
        .collect();
    let Encoder::Plain(encoder) = &model.encoder else {
        panic!("a network of our own")
    };
    let mut params = model.params.as_slice();
    let last = encoder.layers().len() - 1;
    for (k, l) in encoder.layers().enumerate() {
        let (own, rest) = params.split_at(l.n_params());
        params = rest;
        let y = (0..l.outputs).map(|o| {
            let dot: f64 = (0..l.inputs)
                .map(|i| f64::from(own[o * l.inputs + i]) * x[i])
                .sum();
            let y = dot + f64::from(own[l.inputs * l.outputs + o]);
            if k < last { y / (1.0 + (-y).exp()) } else { y }
        });
        x = y.collect();
    }
    x.push(1.0);
    x
}

#[test]
fn frames_together_are_those_one_by_one() {
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let model = model();
    let mut player = Player::new(&model, &avatar).expect("the bones are there");
    let poses: Vec<Pose> = (0..39).map(|k| wave(&avatar, k % 20)).collect();
    let bones: Vec<_> = poses.iter().map(|p| avatar.bones(&figure, p)).collect();
    let n = model.n_verts();
    let mut together = vec![[0.0f32; 3]; n * poses.len()];
    let all: Vec<_> = poses.iter().zip(bones.iter().map(Vec::as_slice)).collect();
    player.frames(&all, &mut together);
    for ((pose, bones), got) in all.into_iter().zip(together.chunks(n)) {
        let mut alone = vec![[0.0f32; 3]; n];
        player.frame(pose, bones, &mut alone);
        assert_eq!(alone, got);
    }
}

#[test]
fn normals_are_those_of_the_faces_around_alone_and_together() {
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let mut model = model();
    // Vertex 36 has no face, 0 and 1 a fan of two apart from each other's.
    model.faces.truncate(34);
    model.faces.push([0, 20, 30]);
    let n = model.n_verts();
    let mut player = Player::new(&model, &avatar).expect("the bones are there");
    let poses: Vec<Pose> = (0..19).map(|k| wave(&avatar, k)).collect();
    let bones: Vec<_> = poses.iter().map(|p| avatar.bones(&figure, p)).collect();
    let all: Vec<_> = poses.iter().zip(bones.iter().map(Vec::as_slice)).collect();
    let [mut x, mut normals] = [(); 2].map(|()| vec![[0.0f32; 3]; n * poses.len()]);
    player.frames_with_normals(&all, (&mut x, &mut normals));
    let wide = |x: [f32; 3]| DVec3::from_array(x.map(f64::from));
    for (k, (pose, bones)) in all.into_iter().enumerate() {
        let (x, together) = (&x[n * k..n * (k + 1)], &normals[n * k..n * (k + 1)]);
        let [mut alone, mut turned] = [(); 2].map(|()| vec![[0.0f32; 3]; n]);
        player.frame_with_normals(pose, bones, (&mut alone, &mut turned));
        assert_eq!(alone, x);
        let mut sums = vec![DVec3::ZERO; n];
        for f in &model.faces {
            let [a, b, c] = f.map(|v| wide(x[v as usize]));
            f.iter()
                .for_each(|v| sums[*v as usize] += (b - a).cross(c - a));
        }
        for v in 0..n {
            let want = sums[v].normalize_or(DVec3::Y);
            for got in [together[v], turned[v]] {
                assert!(wide(got).distance(want) < 1e-4, "{v}: {got:?} for {want}");
            }
        }
    }
}

#[test]
#[should_panic(expected = "one entry per vertex of each pose")]
fn room_for_too_few_frames_is_refused() {
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let mut player = Player::new(&model(), &avatar).expect("the bones are there");
    let pose = wave(&avatar, 3);
    let bones = avatar.bones(&figure, &pose);
    let mut out = vec![[0.0f32; 3]; 2 * player.n_verts() - 1];
    player.frames(&[(&pose, &bones[..]); 2], &mut out);
}

#[test]
fn a_turn_of_the_whole_body_about_the_vertical_turns_the_cloth_alike() {
    let avatar = Avatar::embedded().expect("the embedded body is sound");
    let figure = avatar.figure(&Shape::default()).expect("the default shape");
    let (model, pose) = (model(), wave(&avatar, 9));
    let turn = glam::DQuat::from_rotation_y(1.9);
    let mut turned = pose.clone();
    turned.rotations[0] = turn * turned.rotations[0];
    let mut player = Player::new(&model, &avatar).expect("the bones are there");
    let mut play = |pose: &Pose| {
        let mut out = vec![[0.0f32; 3]; model.n_verts()];
        player.frame(pose, &avatar.bones(&figure, pose), &mut out);
        out
    };
    let (a, b) = (play(&pose), play(&turned));
    let pivot = figure.joints[0] + pose.root;
    for (p, q) in a.iter().zip(&b) {
        let p = DVec3::from_array(p.map(f64::from));
        let want = pivot + DMat3::from_quat(turn) * (p - pivot);
        assert!(want.distance(DVec3::from_array(q.map(f64::from))) < 5e-6);
    }
}

#[test]
fn a_stored_model_comes_back_with_shapes_and_network_of_half_precision() {
    let model = model();
    let stored = model.to_weights();
    assert_eq!(
        stored.notes["format"], "muslin-garment 1",
        "older programs read it"
    );
    assert!(!stored.notes.contains_key("network"));
    let back = Model::from_weights(&stored).expect("it was just written");
    assert_eq!(
        (&back.faces, &back.skin, &back.template),
        (&model.faces, &model.skin, &model.template)
    );
    let kept = back.modes.iter().chain(&back.params);
    for (a, b) in kept.zip(model.modes.iter().chain(&model.params)) {
        assert!((a - b).abs() <= 5e-4 * b.abs() + 1e-7);
    }
    assert_eq!(back.notes.get("garment"), model.notes.get("garment"));
    assert_eq!(Model::from_weights(&back.to_weights()), Ok(back));
}

#[test]
fn a_model_stored_as_it_was_learnt_comes_back_to_the_bit() {
    for model in [model(), told()] {
        let back = Model::from_weights(&model.to_weights_in(Precision::Single));
        let back = back.expect("it was just written");
        assert!(back.modes == model.modes && back.params == model.params);
        assert_eq!(model.to_weights_in(Precision::Half), model.to_weights());
    }
}

#[test]
fn a_packed_model_comes_back_a_twentieth_of_a_millimetre_off_and_broken_ones_are_refused_by_name() {
    let each = [
        (model(), Precision::Twelve, "muslin-garment 4"),
        (told(), Precision::Twelve, "muslin-garment 4"),
        (told(), Precision::Eight, "muslin-garment 6"),
    ];
    for (model, precision, format) in each {
        let packed = model.to_weights_in(precision);
        assert_eq!(packed.notes["format"], format);
        let back = Model::from_weights(&packed).expect("it was just written");
        assert_eq!(
            (&back.traits, &back.encoder),
            (&model.traits, &model.encoder)
        );
        let constant = model.n_codes() - 1;
        for (i, (a, b)) in back.modes.iter().zip(&model.modes).enumerate() {
            let off = (a - b).abs();
            let most = match i % (constant + 1) == constant {
                true => 5e-4 * b.abs() + 1e-7,
                false if precision == Precision::Eight => 8e-4,
                false => 5e-5,
            };
            assert!(off <= most, "{i}: {a} for {b}");
        }
        for name in ["modes", "modes.steps", "modes.rows", "modes.still"] {
            let mut cut = packed.clone();
            cut.arrays.remove(name);
            let fault = Model::from_weights(&cut).expect_err("an array is missing");
            assert!(fault.to_string().contains(name), "{fault}");
            let mut short = packed.clone();
            let array = short.arrays.get_mut(name).expect("it is there");
            array.numbers = match &array.numbers {
                Numbers::U8(v) => Numbers::U8(v[1..].to_vec()),
                Numbers::F16(v) => Numbers::F16(v[1..].to_vec()),
                Numbers::F32(v) => Numbers::F32(v[1..].to_vec()),
                other => panic!("no model has {other:?}"),
            };
            assert!(Model::from_weights(&short).is_err(), "{name}");
        }
    }
}

#[test]
fn a_stored_model_keeps_its_traits_and_broken_ones_are_refused_by_name() {
    let stored = told().to_weights();
    assert_eq!(stored.notes["format"], "muslin-garment 3");
    let back = Model::from_weights(&stored).expect("it was just written");
    assert_eq!(back.traits, told().traits);
    assert_eq!(Model::from_weights(&back.to_weights()), Ok(back));
    let broken = |change: &dyn Fn(&mut muslin_net::Weights)| {
        let mut other = stored.clone();
        change(&mut other);
        Model::from_weights(&other)
            .expect_err("it does not fit")
            .to_string()
    };
    let names = broken(&|w| {
        w.notes.insert("traits".into(), "waist".into());
    });
    assert!(names.contains("traits"), "{names}");
    let range = broken(&|w| {
        let rows = Numbers::F32(vec![0.25, 1.0, 2.0, 0.75, -1.0, 2.0]);
        w.arrays
            .insert("traits".into(), muslin_net::Array::new(&[2, 3], rows));
    });
    assert!(range.contains("traits"), "{range}");
    let number = broken(&|w| {
        let rows = Numbers::F32(vec![f32::NAN; 6]);
        w.arrays
            .insert("traits".into(), muslin_net::Array::new(&[2, 3], rows));
    });
    assert!(number.contains("traits"), "{number}");
    let gone = broken(&|w| {
        w.arrays.remove("traits");
    });
    assert!(gone.contains("traits"), "{gone}");
}

#[test]
fn weights_that_are_no_model_are_refused_by_name() {
    let whole = model().to_weights();
    for name in whole.arrays.keys() {
        let mut cut = whole.clone();
        cut.arrays.remove(name);
        let fault = Model::from_weights(&cut).expect_err("an array is missing");
        assert!(fault.to_string().contains(name.as_str()), "{fault}");
        let mut other = whole.clone();
        other.arrays.get_mut(name).expect("it is there").numbers = Numbers::U8(vec![7; 5]);
        assert!(Model::from_weights(&other).is_err(), "{name}");
    }
    let mut newer = whole.clone();
    newer
        .notes
        .insert("format".into(), "muslin-garment 9".into());
    assert!(Model::from_weights(&newer).is_err());
    let mut nan = model();
    nan.modes[3] = f32::NAN;
    assert!(Model::from_weights(&nan.to_weights()).is_err());
}
