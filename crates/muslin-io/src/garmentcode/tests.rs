use super::*;
use std::path::PathBuf;

/// Two squares of 10 cm, sewn along one edge.
const PAIR: &str = r#"{"pattern": {"panels": {
  "a": {"translation": [0, 100, 20], "rotation": [0, 0, 90],
        "vertices": [[0,0],[10,0],[10,10],[0,10]],
        "edges": [{"endpoints": [0,1]}, {"endpoints": [1,2], "curvature": [0.5, 0.2]},
                  {"endpoints": [2,3]}, {"endpoints": [3,0]}]},
  "b/c": {"vertices": [[0,0],[10,0],[10,10],[0,10]],
        "edges": [{"endpoints": [0,1]}, {"endpoints": [1,2]},
                  {"endpoints": [2,3], "curvature": {"type": "circle", "params": [5, 0, 1]}},
                  {"endpoints": [3,0]}]}},
  "stitches": [[{"panel": "a", "edge": 1}, {"panel": "b/c", "edge": 3}]]},
  "properties": {"units_in_meter": 100, "curvature_coords": "relative"}}"#;

#[test]
fn panels_curves_places_and_seams_come_back_in_metres() {
    let got = read("a.json", PAIR.as_bytes()).expect("valid");
    let [a, b] = &got.pattern.panels[..] else {
        panic!("two panels")
    };
    assert_eq!(got.warnings, [""; 0]);
    assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b/c"));
    assert_eq!(a.corners[2], DVec2::new(0.1, 0.1));
    // Half way along an edge that goes up, two tenths to its left.
    let bulge = DVec2::new(0.08, 0.05);
    assert!(matches!(a.curves[1], Curve::Quadratic(c) if c.distance(bulge) < 1e-12));
    let placed = a
        .world_from_panel
        .transform_point3(DVec3::new(0.1, 0.0, 0.0));
    assert!(
        placed.distance(DVec3::new(0.0, 1.1, 0.2)) < 1e-12,
        "{placed}"
    );
    assert!((b.length(2) - 0.05 * std::f64::consts::PI).abs() < 1e-5);
    let sides = [(0, 1), (1, 3)];
    assert_eq!(
        got.pattern.seams,
        [Seam {
            sides,
            flipped: false
        }]
    );
    assert_eq!(got.pattern.across(1, 3), Some(((0, 1), false)));
}

#[test]
fn broken_patterns_are_named_by_panel_and_edge() {
    let cases = [
        (
            "\"endpoints\": [2,3]}, {\"endpoints\": [3,0]}]},\n  \"b",
            "\"endpoints\": [2,0]}, {\"endpoints\": [3,0]}]},\n  \"b",
            "a.json#/pattern/panels/a/edges/3/endpoints: the outline breaks: edge 2 does not lead to edge 3",
        ),
        (
            "{\"endpoints\": [0,1]}, {\"endpoints\": [1,2], \"curv",
            "{\"endpoints\": [0,9]}, {\"endpoints\": [1,2], \"curv",
            "a.json#/pattern/panels/a/edges/0/endpoints: an edge ends at a vertex that does not exist (found 0, 9, allowed 0 to 3)",
        ),
        (
            "\"circle\"",
            "\"spiral\"",
            "#/pattern/panels/b~1c/edges/2/curvature/type: unknown kind of curve (found spiral, allowed quadratic, cubic or circle)",
        ),
        (
            "[5, 0, 1]",
            "[4, 0, 1]",
            "#/pattern/panels/b~1c/edges/2/curvature/params/0: the circle is too small to reach",
        ),
        ("[5, 0, 1]", "[5, 0]", "another number of parameters"),
        ("[0.5, 0.2]", "[0.5, 1e999]", "a.json:"),
        (
            "[0.5, 0.2]",
            "[0.5, 1e99]",
            "/a/edges/1/curvature/1: the number is out of range",
        ),
        (
            "\"panel\": \"b/c\"",
            "\"panel\": \"d\"",
            "#/pattern/stitches/0/1/panel: a stitch names a panel that does not exist (found d)",
        ),
        (
            "\"edge\": 3",
            "\"edge\": 4",
            "#/pattern/stitches/0/1/edge: a stitch names an edge that panel b/c does not have (found 4, allowed 0 to 3)",
        ),
        (
            "\"panel\": \"b/c\", \"edge\": 3",
            "\"panel\": \"a\", \"edge\": 1",
            "#/pattern/stitches/0/1: this edge is sewn twice (found also in stitch 0)",
        ),
        (
            "[10,10],[0,10]],\n        \"edges\": [{\"endpoints\": [0,1]}, {\"endpoints\": [1,2], \"c",
            "[10,10],[\"x\",10]],\n        \"edges\": [{\"endpoints\": [0,1]}, {\"endpoints\": [1,2], \"c",
            "/a/vertices/3/0: a number is expected here (found \"x\")",
        ),
        (
            "\"vertices\": [[0,0],[10,0]",
            "\"vertices\": [[0,0],[0,0]",
            "/a/edges/0: an edge without length (found 0.000 mm)",
        ),
        ("\"vertices\"", "\"corners\"", "/a: \"vertices\" is missing"),
        (
            "\"units_in_meter\": 100",
            "\"units_in_meter\": 0",
            "#/properties/units_in_meter: the number is out of range",
        ),
        ("\"pattern\"", "\"body\"", "JSON, but no sewing pattern"),
        ("\"panels\": {", "\"panels\": [{", "this is not JSON"),
    ];
    for (from, to, want) in cases {
        assert!(PAIR.contains(from), "{from}");
        let text = PAIR.replacen(from, to, 1);
        let err = read("a.json", text.as_bytes()).expect_err(want);
        assert!(err.to_string().contains(want), "{err}\nwanted {want}");
        assert_eq!(err.exit_code(), 3, "{err}");
    }
}

#[test]
fn sizes_are_limited_before_anything_is_made() {
    let many: Vec<String> = (0..300).map(|i| format!("\"p{i}\": {{}}")).collect();
    let text = format!("{{\"pattern\": {{\"panels\": {{{}}}}}}}", many.join(","));
    let err = read("a.json", text.as_bytes()).expect_err("300 panels");
    assert_eq!(err.exit_code(), 4, "{err}");
    let text = PAIR.replacen("[[0,0],", &format!("[{}", "[0,0],".repeat(2000)), 1);
    let err = read("a.json", text.as_bytes()).expect_err("2000 vertices");
    assert_eq!(err.exit_code(), 4, "{err}");
    let deep = "[".repeat(100_000);
    assert_eq!(
        read("a.json", deep.as_bytes())
            .expect_err("deep")
            .exit_code(),
        3
    );
    let cut = &PAIR[..PAIR.len() / 2];
    assert_eq!(
        read("a.json", cut.as_bytes()).expect_err("cut").exit_code(),
        3
    );
}

#[test]
fn what_the_file_leaves_open_is_said() {
    let text = PAIR.replace("\"units_in_meter\": 100,", "");
    let got = read("a.json", text.as_bytes()).expect("valid");
    assert!(
        got.warnings[0].contains("centimetres"),
        "{:?}",
        got.warnings
    );
    let text = PAIR.replace("[[0,0],[10,0],[10,10],[0,10]],\n        \"edges\": [{\"endpoints\": [0,1]}, {\"endpoints\": [1,2]},", "[[0,0],[10,0],[10,40],[0,40]],\n        \"edges\": [{\"endpoints\": [0,1]}, {\"endpoints\": [1,2]},");
    let got = read("a.json", text.as_bytes()).expect("valid");
    assert!(got.warnings[0].contains("gathered"), "{:?}", got.warnings);
}

#[test]
fn the_shared_patterns_are_read_and_their_seams_fit() {
    let Some(data) = std::env::var_os("MUSLIN_DATA").map(PathBuf::from) else {
        return println!("skipped: needs MUSLIN_DATA");
    };
    let folder = data.join("garments/garmentcode-patterns");
    let wants = [
        ("dress_pencil", 6, 23),
        ("js_mean_all", 12, 57),
        ("shirt_mean", 8, 18),
    ];
    for (name, panels, seams) in wants {
        let file = format!("{name}_specification.json");
        let bytes = std::fs::read(folder.join(&file)).expect("the shared file");
        let got = read(&file, &bytes).expect("valid");
        assert_eq!(got.warnings, [""; 0], "{name}");
        let pattern = &got.pattern;
        assert_eq!((pattern.panels.len(), pattern.seams.len()), (panels, seams));
        for seam in &pattern.seams {
            let [a, b] = seam
                .sides
                .map(|(p, k)| pattern.panels[p as usize].length(k as usize));
            // The dress gathers its front into the skirt by a quarter.
            assert!((0.7..1.4).contains(&(a / b)), "{name} {seam:?}: {a} {b}");
        }
    }
}
