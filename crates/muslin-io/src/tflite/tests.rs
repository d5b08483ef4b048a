//! A small model written here, read back, run, cut short and spoilt.

use muslin_net::{Net, Scratch};

use super::*;

/// A FlatBuffer in the making.
enum Part {
    Table(Vec<Part>),
    Tables(Vec<Part>),
    Ints(Vec<i32>),
    Bytes(Vec<u8>),
    Number(i32),
    Absent,
}

use Part::{Absent, Bytes, Ints, Number, Table as T, Tables};

/// Appends a part; what it refers to follows it. Returns where it lies.
fn write(out: &mut Vec<u8>, part: &Part) -> usize {
    match part {
        T(fields) => write_table(out, fields),
        Tables(parts) => {
            let at = write_counted(out, parts.len(), &vec![0; parts.len() * 4]);
            for (i, part) in parts.iter().enumerate() {
                refer(out, at + 4 + 4 * i, part);
            }
            at
        }
        Ints(x) => {
            let bytes: Vec<u8> = x.iter().flat_map(|x| x.to_le_bytes()).collect();
            write_counted(out, x.len(), &bytes)
        }
        Bytes(x) => write_counted(out, x.len(), x),
        Number(_) | Absent => unreachable!("only fields of a table"),
    }
}

fn write_counted(out: &mut Vec<u8>, n: usize, bytes: &[u8]) -> usize {
    let at = out.len();
    out.extend((n as u32).to_le_bytes());
    out.extend(bytes);
    at
}

/// The vtable, then the table, every field four bytes wide.
fn write_table(out: &mut Vec<u8>, fields: &[Part]) -> usize {
    let vtable = out.len();
    let slot = |(i, f): (usize, &Part)| {
        if matches!(f, Absent) {
            0
        } else {
            4 + 4 * i as u16
        }
    };
    let head = [4 + 2 * fields.len() as u16, 4 + 4 * fields.len() as u16];
    let slots = fields.iter().enumerate().map(slot);
    out.extend(head.into_iter().chain(slots).flat_map(u16::to_le_bytes));
    let at = out.len();
    out.extend(((at - vtable) as i32).to_le_bytes());
    out.resize(out.len() + 4 * fields.len(), 0);
    for (i, field) in fields.iter().enumerate() {
        match field {
            Absent => {}
            Number(n) => out[at + 4 + 4 * i..][..4].copy_from_slice(&n.to_le_bytes()),
            part => refer(out, at + 4 + 4 * i, part),
        }
    }
    at
}

fn refer(out: &mut Vec<u8>, from: usize, part: &Part) {
    let offset = (write(out, part) - from) as u32;
    out[from..from + 4].copy_from_slice(&offset.to_le_bytes());
}

fn ints(x: &[i32]) -> Part {
    Ints(x.to_vec())
}

/// A tensor whose values, if any, are in buffer `buffer`.
fn value(shape: &[i32], kind: i32, buffer: i32, sparsity: Part) -> Part {
    let name = Bytes(b"value".to_vec());
    T(vec![
        ints(shape),
        Number(kind),
        Number(buffer),
        name,
        Absent,
        Absent,
        sparsity,
    ])
}

fn operator(code: i32, inputs: &[i32], output: i32, (kind, options): (i32, &[i32])) -> Part {
    let options = T(options.iter().map(|&o| Number(o)).collect());
    T(vec![
        Number(code),
        ints(inputs),
        ints(&[output]),
        Number(kind),
        options,
    ])
}

fn halves(x: &[f32]) -> Part {
    let bytes = x.iter().flat_map(|&x| half::f16::from_f32(x).to_le_bytes());
    T(vec![Bytes(bytes.collect())])
}

fn whole(x: &[i32]) -> Part {
    T(vec![Bytes(
        x.iter().flat_map(|x| x.to_le_bytes()).collect(),
    )])
}

/// Two of four weights, listed along the last axis.
fn diagonal() -> Part {
    let dense = |n| T(vec![Number(0), Number(n)]);
    let list = |x: &[u8]| T(vec![Bytes(x.to_vec())]);
    let listed = T(vec![
        Number(1),
        Absent,
        Number(3),
        list(&[0, 1, 2]),
        Number(3),
        list(&[0, 1]),
    ]);
    let levels = vec![dense(2), dense(1), dense(1), listed];
    T(vec![ints(&[0, 1, 2, 3]), Absent, Tables(levels)])
}

/// Weights filled in and widened, a convolution, zeros, the largest, flattened, joined to itself.
fn model() -> Vec<u8> {
    let tensors = vec![
        value(&[1, 2, 2, 2], 0, 0, Absent),
        value(&[2, 1, 1, 2], 1, 1, diagonal()),
        value(&[2, 1, 1, 2], 1, 0, Absent),
        value(&[2, 1, 1, 2], 0, 0, Absent),
        value(&[2], 1, 2, Absent),
        value(&[2], 0, 0, Absent),
        value(&[1, 2, 2, 2], 0, 0, Absent),
        value(&[4, 2], 2, 3, Absent),
        value(&[1, 3, 2, 2], 0, 0, Absent),
        value(&[1, 1, 1, 2], 0, 0, Absent),
        value(&[1, 2], 0, 0, Absent),
        value(&[1, 4], 0, 0, Absent),
    ];
    let operators = vec![
        operator(0, &[1], 2, (0, &[])),
        operator(1, &[2], 3, (0, &[])),
        operator(1, &[4], 5, (0, &[])),
        operator(2, &[0, 3, 5], 6, (1, &[0, 1, 1, 3])),
        operator(3, &[6, 7], 8, (22, &[])),
        operator(4, &[8], 9, (5, &[1, 1, 1, 2, 3])),
        operator(5, &[9], 10, (0, &[])),
        operator(6, &[10, 10], 11, (10, &[-1])),
    ];
    let codes =
        [124, 6, 3, 34, 17, 22, 2].map(|c| T(vec![Number(c.min(127)), Absent, Absent, Number(c)]));
    let buffers = vec![
        T(vec![]),
        halves(&[1.5, -2.0]),
        halves(&[0.5, 1.0]),
        whole(&[0, 0, 1, 0, 0, 0, 0, 0]),
    ];
    let main = T(vec![
        Tables(tensors),
        ints(&[0]),
        ints(&[11]),
        Tables(operators),
    ]);
    let root = T(vec![
        Number(3),
        Tables(codes.into()),
        Tables(vec![main]),
        Absent,
        Tables(buffers),
    ]);
    let mut out = [&[0; 4][..], b"TFL3"].concat();
    let at = write(&mut out, &root) as u32;
    out[..4].copy_from_slice(&at.to_le_bytes());
    out
}

/// Reads and runs, wherever that leads.
fn use_it(bytes: &[u8]) -> Option<Vec<f32>> {
    let graph = read_tflite(bytes).ok()?;
    let net = Net::new(&graph, &[0]).ok()?;
    let input = [0.0, 1.0, 1.0, -1.0, 2.0, -1.5, 3.0, 0.0];
    net.run(&[&input], &mut Scratch::default())
        .ok()
        .map(|out| out[0].to_vec())
}

#[test]
fn a_model_computes_what_it_says() {
    let graph = read_tflite(&model()).expect("it is whole");
    assert_eq!(
        graph.tensors[3].data.as_deref(),
        Some(&[1.5, 0.0, 0.0, -2.0][..])
    );
    assert_eq!(graph.tensors[6].name, "value");
    assert_eq!(graph.nodes.len(), 5);
    assert_eq!(use_it(&model()), Some(vec![5.0, 4.0, 5.0, 4.0]));
}

#[test]
fn a_cut_model_is_refused_at_every_length() {
    let whole = model();
    for n in 0..whole.len() {
        let err = read_tflite(&whole[..n]).expect_err("something is missing");
        assert!(err.at <= whole.len(), "cut at {n}: {err}");
    }
}

#[test]
fn no_spoilt_byte_leads_astray() {
    let whole = model();
    let mut refused = 0;
    for i in 0..whole.len() {
        for to in [
            0,
            1,
            0x7f,
            0x80,
            0xff,
            whole[i].wrapping_add(1),
            whole[i].wrapping_add(4),
        ] {
            let mut spoilt = whole.clone();
            spoilt[i] = to;
            refused += usize::from(use_it(&spoilt).is_none());
        }
    }
    assert!(refused > whole.len(), "only {refused} refused");
}

#[test]
fn what_is_not_read_here_is_named() {
    assert!(read_tflite(b"").is_err_and(|e| e.at == 4));
    assert!(read_tflite(b"\x89PNG\r\n\x1a\n0000").is_err_and(|e| e.what.contains("TFL3")));
    let mut other = model();
    let softmax = other
        .iter()
        .position(|&b| b == 17)
        .expect("max pooling has a code");
    other
        .iter_mut()
        .skip(softmax)
        .filter(|b| **b == 17)
        .for_each(|b| *b = 25);
    assert!(read_tflite(&other).is_err_and(|e| e.to_string().contains("operator 25")));
}
