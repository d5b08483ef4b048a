use super::*;
use std::path::PathBuf;

/// Written by NumPy 2.4 with `savez_compressed`: see `tests/data/npz_fixture.py`.
const FIXTURE: &[u8] = include_bytes!("../../tests/data/numpy.npz");

#[test]
fn what_numpy_packed_is_read() {
    let npz = read("numpy.npz", FIXTURE).expect("NumPy's own");
    let floats = |name: &str| npz.get(name).and_then(Array::floats).expect(name);
    let ramp: Vec<f64> = (0..24).map(|i| f64::from(i) * 0.5).collect();
    for name in ["f4", "f8", "f2", "big", "fortran"] {
        assert_eq!(npz.get(name).expect(name).shape, [2, 3, 4], "{name}");
        assert_eq!(floats(name), ramp, "{name}");
    }
    assert_eq!(
        npz.triangles("faces", 4).expect("in range"),
        [[0, 1, 2], [1, 3, 2]]
    );
    assert!(npz.triangles("faces", 3).is_err());
    assert_eq!(floats("fps"), [30.0]);
    assert_eq!(npz.get("fps").expect("fps").shape, [0; 0]);
    let words = ["root", "spine05", "µ"].map(String::from).to_vec();
    assert_eq!(npz.get("bones"), Some(&Array::text(words)));
    assert_eq!(floats("truth"), [1.0, 0.0]);
    assert_eq!(floats("empty"), [0.0; 0]);
}

fn sample() -> Vec<(&'static str, Array)> {
    vec![
        (
            "cloth",
            Array::f32(&[1, 2, 3], vec![0.0, 1.5, -2.0, 3.0, 1e-20, 7e9]),
        ),
        ("faces", Array::int(&[1, 3], vec![0, 1, 0])),
        ("fps", Array::number(60.0)),
        ("bones", Array::text(vec!["a".into(), "bcd".into()])),
    ]
}

#[test]
fn what_we_write_comes_back_the_same() {
    let bytes = write(&sample()).expect("finite");
    let npz = read("a.npz", &bytes).expect("whole");
    for (name, array) in sample() {
        assert_eq!(npz.get(name), Some(&array), "{name}");
    }
    assert_eq!(write(&sample()).expect("finite"), bytes);
}

#[test]
fn what_is_not_finite_or_does_not_fit_is_not_written() {
    let bad = [
        Array::f32(&[1], vec![f32::NAN]),
        Array::number(f64::INFINITY),
        Array::int(&[1], vec![1 << 40]),
        Array::f32(&[2], vec![0.0]),
    ];
    for array in bad {
        assert!(write(&[("x", array.clone())]).is_err(), "{array:?}");
    }
}

#[test]
fn no_prefix_and_no_flipped_byte_panics() {
    for whole in [write(&sample()).expect("finite"), FIXTURE.to_vec()] {
        for end in 0..whole.len() {
            assert!(read("a.npz", &whole[..end]).is_err());
        }
        let mut bytes = whole.clone();
        for at in 0..whole.len() {
            bytes[at] ^= 0x41;
            let _ = read("a.npz", &bytes);
            bytes[at] ^= 0x41;
        }
    }
}

#[test]
fn a_member_that_lies_about_its_size_costs_no_memory() {
    let mut bytes = write(&[("x", Array::number(1.0))]).expect("finite");
    let list = bytes
        .windows(4)
        .position(|w| w == b"PK\x01\x02")
        .expect("a list");
    bytes[list + 24..list + 28].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    assert!(read("a.npz", &bytes).is_err());
    bytes[list + 10] = 8;
    assert!(read("a.npz", &bytes).is_err());
}

/// A `.npy` file of such a type and shape.
fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape},), }}\n");
    let length = (text.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\0", &length[..], text.as_bytes(), data].concat()
}

#[test]
fn words_without_letters_and_words_beyond_all_numbers_cost_no_memory() {
    for (descr, shape) in [
        ("|S0", "10000000000000"),
        ("<U0", "4611686018427387904"),
        ("<f0", "3"),
        ("<U9223372036854775807", "1"),
        ("|S9223372036854775807", "3"),
    ] {
        let mut zip = zip::Writer::default();
        zip.add("x.npy", &npy(descr, shape, &[])).expect("small");
        let fault = read("a.npz", &zip.finish()).expect_err(descr);
        assert_eq!(fault.exit_code(), 3, "{fault}");
    }
}

#[test]
fn what_arrays_need_in_memory_is_limited_not_what_they_are_in_the_file() {
    for (descr, data, need) in [
        ("|i1", vec![0; 6], 48),
        ("|b1", vec![1; 6], 48),
        ("<f2", vec![0; 12], 24),
        ("<f8", vec![0; 48], 48),
        ("|S1", vec![b'a'; 6], 6 * (4 + size_of::<String>())),
        ("<U1", vec![0; 24], 6 * (4 + size_of::<String>())),
    ] {
        let bytes = npy(descr, "6", &data);
        let mut memory = need;
        assert!(npy::read(&bytes, &mut memory).is_ok(), "{descr}");
        assert_eq!(memory, 0, "{descr}");
        let short = npy::read(&bytes, &mut (need - 1)).expect_err(descr);
        let fault = short.told(|what| Fault::new("npz-large", "a.npz", what));
        assert_eq!(fault.exit_code(), 4, "{fault}");
    }
}

#[test]
fn an_archive_of_too_many_members_is_refused() {
    let mut bytes = write(&[("x", Array::number(1.0))]).expect("finite");
    let end = bytes.len() - 22;
    bytes[end + 10..end + 12].copy_from_slice(&4097u16.to_le_bytes());
    let fault = read("a.npz", &bytes).expect_err("4097 members");
    assert_eq!((fault.code(), fault.exit_code()), ("npz-large", 4));
    assert!(fault.to_string().contains("allowed 4096"), "{fault}");
}

#[test]
fn hostile_archives_are_errors() {
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let mut n = 0;
    for folder in ["npy", "zip-for-npz"] {
        for entry in std::fs::read_dir(data.join("robustness").join(folder)).expect("folder") {
            let path = entry.expect("entry").path();
            let error = read("x.npz", &std::fs::read(&path).expect("readable"));
            assert!(error.is_err(), "{}", path.display());
            n += 1;
        }
    }
    let pickle = std::fs::read(data.join("robustness/npy/py2-objarr.npz")).expect("readable");
    let error = read("x.npz", &pickle).expect_err("pickled");
    assert!(error.to_string().contains("pickled"), "{error}");
    assert!(n > 5);
}
