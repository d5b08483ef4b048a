//! Fabric files that are whole, and hostile ones.

use super::*;

const WHOLE: &str = r##"
# Measured on one cloth.
name = "Heavy Twill"   # becomes heavy-twill
source = 'own "KES" figures'
mass_g_m2 = 310
thickness_mm = 0.62
stretch_warp_n_m = 2_400.5
stretch_weft_n_m = 1.9e3
shear_n_m = 300
bend_warp_unm = 21
bend_weft_unm = 17.5
friction = 0.45
strain_limit_percent = 5
colour = "#ff0080"
"##;

fn read(text: &str) -> Result<FabricFile, IoError> {
    parse_fabric("own.toml", "own", text.as_bytes())
}

#[test]
fn a_whole_file_is_read_in_its_units() {
    let fabric = read(WHOLE).expect("a whole file").fabric;
    assert_eq!(fabric.name, "heavy-twill");
    assert_eq!(fabric.source, "own \"KES\" figures");
    assert!((fabric.density - 0.31).abs() < 1e-15 && fabric.stretch_warp == 2400.5);
    assert!((fabric.bend_weft - 17.5e-6).abs() < 1e-18 && fabric.stretch_weft == 1900.0);
    assert_eq!(fabric.strain_limit, Some(0.05));
    assert_eq!(fabric.look.colour[0], 1.0);
}

#[test]
fn what_is_left_out_comes_from_a_preset_or_is_asked_for() {
    let fabric = read("like = \"denim\"\nmass_g_m2 = 500")
        .expect("like a preset")
        .fabric;
    let denim = Fabric::named("denim").expect("a preset");
    assert_eq!((fabric.name.as_str(), fabric.density), ("own", 0.5));
    assert_eq!(
        (fabric.bend_warp, fabric.strain_limit),
        (denim.bend_warp, denim.strain_limit)
    );
    let fault = read("mass_g_m2 = 500").expect_err("most is missing");
    assert_eq!(fault.code(), "fabric-missing");
    assert!(fault.to_string().contains("thickness_mm"), "{fault}");
}

#[test]
fn hostile_files_are_refused_with_their_line() {
    for (text, says) in [
        ("[fabric]", "one `key = value` a line"),
        ("\nmas_g_m2 = 3", "mass_g_m2"),
        ("mass_g_m2 = 3\nmass_g_m2 = 4", "given before"),
        ("mass_g_m2 = nan", "number"),
        ("mass_g_m2 = 1e999", "number"),
        ("mass_g_m2 = 1__0", "number"),
        ("mass_g_m2 = \"300\"", "must be a number"),
        ("name = \"abc", "not closed"),
        ("name = \"\"\"abc\"\"\"", "number or text"),
        ("name = 'a' 'b'", "behind the value"),
        ("name = 7", "text in quotes"),
        ("like = \"denym\"", "denim"),
        ("like = \"denim\"\ncolour = \"red\"", "no colour"),
        ("like = \"denim\"\nmass_g_m2 = -4", "density"),
        ("", "not given"),
        ("\u{0}", "key = value"),
    ] {
        let fault = read(text).expect_err(text);
        assert!(
            fault.message().contains(says),
            "{text:?}: {}",
            fault.message()
        );
    }
    assert!(parse_fabric("x", "x", &[0xff, 0xfe]).is_err());
}

const U3M: &str = r#"{"custom": {"browzwear": {
    "bend": {"length": 15.9, "width": 24.06}, "category": "Knits", "friction": 0.2,
    "hysteresis": {"length": 0.0, "width": 0.0}, "mass": 300.0, "name": "QA Knit",
    "shear": 30.96, "stretch": {"length": 72.36, "width": 51.73},
    "stretch_linearity": {"length": 98.97, "width": 5.0}, "thickness": 0.202}}}"#;

#[test]
fn u3m_physics_is_read_in_its_units_and_says_what_is_left_out() {
    for text in [U3M.to_owned(), format!("{{\"physics\": {U3M}}}")] {
        let read = read(&text).expect("sound physics");
        let fabric = read.fabric;
        assert_eq!((fabric.name.as_str(), fabric.density), ("qa-knit", 0.3));
        assert!(
            (fabric.bend_warp - 1.59e-6).abs() < 1e-18,
            "dyne centimetres"
        );
        assert_eq!((fabric.stretch_warp, fabric.stretch_weft), (72.36, 51.73));
        assert_eq!(fabric.confidence, Confidence::Measured);
        assert_eq!(
            read.warnings,
            ["fabric qa-knit: its stretch is taken as linear"]
        );
    }
    for (text, says) in [
        ("{", "not JSON"),
        ("{\"material\": {}}", "how it moves"),
        (
            "{\"custom\": {\"browzwear\": {\"mass\": \"x\"}}}",
            "mass is not a number",
        ),
    ] {
        let fault = read(text).expect_err(text);
        assert!(fault.message().contains(says), "{}", fault.message());
    }
}

/// An archive of these files.
fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = crate::zip::Writer::default();
    for (name, data) in files {
        zip.add(name, data).expect("a small archive");
    }
    zip.finish()
}

#[test]
fn an_archive_of_too_many_members_is_refused() {
    let mut bytes = archive(&[("knit.json", U3M.as_bytes())]);
    let end = bytes.len() - 22;
    bytes[end + 10..end + 12].copy_from_slice(&4097u16.to_le_bytes());
    let fault = parse_fabric("k.u3ma", "k", &bytes).expect_err("4097 members");
    assert_eq!((fault.code(), fault.exit_code()), ("fabric-archive", 4));
    assert!(fault.to_string().contains("allowed 4096"), "{fault}");
}

#[test]
fn an_archive_gives_the_physics_in_it_and_names_what_is_wrong() {
    let looks: (&str, &[u8]) = ("Knit.u3m", b"{\"schema\": \"1.0\", \"material\": {}}");
    let picture: (&str, &[u8]) = ("textures/knit.jpg", &[0xff, 0xd8]);
    let physics = ("physics/knit.json", U3M.as_bytes());
    let read = |files: &[(&str, &[u8])]| parse_fabric("k.u3ma", "k", &archive(files));
    let both = read(&[picture, looks, physics]).expect("physics beside the looks");
    assert_eq!(
        both,
        parse_fabric("k.u3ma/physics/knit.json", "k", U3M.as_bytes()).expect("sound")
    );
    let within = read(&[picture, ("knit.U3M", U3M.as_bytes())]).expect("physics within");
    assert_eq!(within.fabric.name, "qa-knit");
    let broken = ("knit.u3m", &b"{\"custom\": {\"browzwear\": {}}}"[..]);
    for (files, code, says) in [
        (&[looks, picture][..], "fabric-physics", "Knit.u3m"),
        (&[picture], "fabric-archive", "no U3M material"),
        (&[broken], "fabric-missing", "k.u3ma/knit.u3m"),
        (&[("a.json", &[0xff])], "fabric-text", "k.u3ma/a.json"),
    ] {
        let fault = read(files).expect_err(says);
        assert_eq!(fault.code(), code);
        let told = format!("{} {fault}", fault.message());
        assert!(told.contains(says), "{told}");
    }
    let whole = archive(&[physics]);
    for end in 4..whole.len() {
        assert!(
            parse_fabric("k.u3ma", "k", &whole[..end]).is_err(),
            "cut at {end}"
        );
    }
}

#[test]
fn the_example_that_comes_with_u3m_is_a_light_knit() {
    let Some(data) = std::env::var_os("MUSLIN_DATA") else {
        eprintln!("skipped: the_example_that_comes_with_u3m_is_a_light_knit (no MUSLIN_DATA)");
        return;
    };
    let folder = Path::new(&data).join("fabrics/u3m");
    let knit = read_fabric(&folder.join("physics_example.json"))
        .expect("the example")
        .fabric;
    assert!((knit.density - 0.3).abs() < 1e-12 && (knit.bend_weft - 2.4e-6).abs() < 1e-8);
    let look = read_fabric(&folder.join("Example_1.0.u3m")).expect_err("it has no physics");
    assert_eq!(look.code(), "fabric-physics");
}
