//! The layers that learn, against an independent implementation and against finite differences.

use muslin_net::learn::{
    Adam, AdamState, Gru, GruTape, Linear, Mlp, MlpTape, Noise, Nonlinear, Sgd,
};
use serde_json::Value;

fn fixture(layer: &str) -> impl Fn(&str) -> Vec<f32> {
    let text = include_str!("fixtures/layers.json");
    let all: Value = serde_json::from_str(text).expect("the fixture is JSON");
    let own = all[layer].clone();
    move |name| {
        let list = own[name].as_array().expect("a list of numbers");
        list.iter()
            .map(|x| x.as_f64().expect("a number") as f32)
            .collect()
    }
}

fn close(what: &str, got: &[f32], want: &[f32]) {
    assert_eq!(got.len(), want.len(), "{what}");
    let size = want.iter().fold(1.0f32, |m, x| m.max(x.abs()));
    for (g, w) in got.iter().zip(want) {
        assert!(
            (g - w).abs() < 3e-6 * size,
            "{what}: {g} where {w} is right"
        );
    }
}

#[test]
fn a_perceptron_and_its_gradient_are_those_of_jax() {
    for (layer, bend) in [("mlp", Nonlinear::Silu), ("selu", Nonlinear::Selu)] {
        let f = fixture(layer);
        let mlp = Mlp {
            widths: vec![3, 4, 2],
            bend,
            bias: true,
        };
        let (params, mut tape) = (f("params"), MlpTape::default());
        close(
            layer,
            mlp.forward(&params, (&f("x"), 5), &mut tape),
            &f("y"),
        );
        let mut d = vec![0.0; mlp.n_params()];
        mlp.backward(&params, &tape, &f("weights"), &mut d);
        close(layer, &d, &f("gradient"));
    }
}

#[test]
fn three_steps_of_a_recurrent_layer_and_the_way_back_are_those_of_jax() {
    let f = fixture("gru");
    let gru = Gru {
        inputs: 3,
        size: 4,
        bias: true,
    };
    let (params, xs) = (f("params"), f("xs"));
    let mut h = f("h");
    let mut tapes = vec![GruTape::default(); 3];
    for (x, tape) in xs.chunks(6).zip(&mut tapes) {
        let mut next = vec![0.0; 8];
        gru.forward(&params, (x, &h, 2), (&mut next, tape));
        h = next;
    }
    close("state", &h, &f("y"));
    let (mut d, mut dxs, mut dh) = (vec![0.0; gru.n_params()], vec![0.0; 18], f("weights"));
    for (dx, tape) in dxs.chunks_mut(6).zip(&tapes).rev() {
        let mut before = vec![0.0; 8];
        gru.backward(&params, (tape, &dh), &mut d, (dx, &mut before));
        dh = before;
    }
    close("gradient", &d, &f("gradient"));
    close("inputs", &dxs, &f("dxs"));
    close("first state", &dh, &f("dh"));
}

#[test]
fn twenty_steps_of_adam_end_where_the_paper_says() {
    let f = fixture("adam");
    let (mut p, mut state) = (f("start"), AdamState::default());
    let adam = Adam {
        rate: 0.05,
        ..Adam::default()
    };
    for _ in 0..20 {
        let g = valleys(&p);
        adam.step(&mut state, &mut p, &g);
    }
    close("parameters", &p, &f("end"));
    assert_eq!(state.steps, 20);
}

/// Slopes of a function of several valleys.
fn valleys(p: &[f32]) -> Vec<f32> {
    let slope = |(k, p): (usize, &f32)| p.powi(3) - p * 2.0 * k as f32 / 7.0 + 1.0;
    p.iter().enumerate().map(slope).collect()
}

#[test]
fn twenty_steps_with_momentum_end_where_those_of_jax_do() {
    let f = fixture("momentum");
    let (mut p, mut velocity) = (f("start"), Vec::new());
    let sgd = Sgd {
        rate: 0.02,
        momentum: 0.9,
    };
    for _ in 0..20 {
        let g = valleys(&p);
        sgd.step(&mut velocity, &mut p, &g);
    }
    close("parameters", &p, &f("end"));
}

/// `loss` and its gradient at `p`, against central differences in every direction of `p`.
fn check_slope(p: &[f32], gradient: &[f32], loss: impl Fn(&[f32]) -> f64) {
    let size = gradient.iter().fold(1.0f32, |m, x| m.max(x.abs()));
    for k in 0..p.len() {
        let at = |step: f32| {
            let mut q = p.to_vec();
            q[k] += step;
            loss(&q)
        };
        let slope = (at(0.01) - at(-0.01)) / 0.02;
        let off = (slope - f64::from(gradient[k])).abs();
        assert!(
            off < 2e-3 * f64::from(size),
            "{k}: {slope} against {}",
            gradient[k]
        );
    }
}

fn weighted(y: &[f32], t: &[f32]) -> f64 {
    y.iter()
        .zip(t)
        .map(|(y, t)| f64::from(*y) * f64::from(*t))
        .sum()
}

#[test]
fn every_nonlinear_has_the_slope_of_its_value() {
    let x: Vec<f32> = (-20..20).map(|i| 0.17 * i as f32 + 0.05).collect();
    let all = [
        Nonlinear::Relu,
        Nonlinear::Tanh,
        Nonlinear::Silu,
        Nonlinear::Selu,
    ];
    for f in all {
        let mut d = vec![1.0; x.len()];
        f.backward(&x, &mut d);
        check_slope(&x, &d, |x| {
            let mut y = vec![0.0; x.len()];
            f.forward(x, &mut y);
            weighted(&y, &vec![1.0; y.len()])
        });
        assert_eq!(Nonlinear::named(f.name()), Some(f));
    }
}

#[test]
fn linear_layers_have_the_slopes_of_their_values_in_parameters_and_inputs() {
    let mut noise = Noise::new(5);
    for bias in [true, false] {
        let layer = Linear {
            inputs: 3,
            outputs: 2,
            bias,
        };
        let (p, x, t) = (
            noise.normals(layer.n_params()),
            noise.normals(12),
            noise.normals(8),
        );
        let (mut d, mut dx) = (vec![0.0; p.len()], vec![0.0; 12]);
        layer.backward(&p, (&x, &t, 4), &mut d, Some(&mut dx));
        let loss = |p: &[f32], x: &[f32]| {
            let mut y = vec![f32::NAN; 8];
            layer.forward(p, (x, 4), &mut y);
            weighted(&y, &t)
        };
        check_slope(&p, &d, |p| loss(p, &x));
        check_slope(&x, &dx, |x| loss(&p, x));
    }
}

#[test]
fn without_biases_nothing_in_is_nothing_out() {
    let mut noise = Noise::new(6);
    let mlp = Mlp {
        widths: vec![5, 7, 3],
        bend: Nonlinear::Silu,
        bias: false,
    };
    let p = mlp.start(&mut noise);
    let mut tape = MlpTape::default();
    assert!(
        mlp.forward(&p, (&[0.0; 10], 2), &mut tape)
            .iter()
            .all(|y| *y == 0.0)
    );
    let gru = Gru {
        inputs: 5,
        size: 4,
        bias: false,
    };
    let p = gru.start(&mut noise);
    let (mut next, mut tape) = (vec![1.0; 8], GruTape::default());
    gru.forward(&p, (&[0.0; 10], &[0.0; 8], 2), (&mut next, &mut tape));
    assert!(next.iter().all(|h| *h == 0.0));
}

#[test]
fn a_recurrent_layer_without_biases_has_the_slopes_of_its_values() {
    let mut noise = Noise::new(8);
    let gru = Gru {
        inputs: 2,
        size: 3,
        bias: false,
    };
    let p = gru.start(&mut noise);
    let (x, h, t) = (noise.normals(4), noise.normals(6), noise.normals(6));
    let (mut next, mut tape) = (vec![0.0; 6], GruTape::default());
    gru.forward(&p, (&x, &h, 2), (&mut next, &mut tape));
    let (mut d, mut dx, mut dh) = (vec![0.0; p.len()], vec![0.0; 4], vec![0.0; 6]);
    gru.backward(&p, (&tape, &t), &mut d, (&mut dx, &mut dh));
    let loss = |p: &[f32], x: &[f32], h: &[f32]| {
        let (mut next, mut tape) = (vec![0.0; 6], GruTape::default());
        gru.forward(p, (x, h, 2), (&mut next, &mut tape));
        weighted(&next, &t)
    };
    check_slope(&p, &d, |p| loss(p, &x, &h));
    check_slope(&x, &dx, |x| loss(&p, x, &h));
    check_slope(&h, &dh, |h| loss(&p, &x, h));
}
