//! Reports out: a [`Report`] as JSON that people read and programs parse.

use muslin_geom::{Report, Value};

/// The report as indented JSON (RFC 8259) with a line break at its end.
///
/// Names keep their order; whole numbers have no fraction; what is not finite is `null`; a list
/// of plain values stays on one line.
pub fn report_json(report: &Report) -> String {
    let mut out = String::new();
    tree(&mut out, report, 0);
    out.push('\n');
    out
}

fn tree(out: &mut String, report: &Report, depth: usize) {
    let entries = report.entries();
    if entries.is_empty() {
        out.push_str("{}");
        return;
    }
    out.push('{');
    for (i, (name, value)) in entries.iter().enumerate() {
        open_line(out, i, depth + 1);
        *out += &format!("{}: ", text(name));
        write(out, value, depth + 1);
    }
    close_line(out, depth);
    out.push('}');
}

fn list(out: &mut String, values: &[Value], depth: usize) {
    let is_nested = values
        .iter()
        .any(|v| matches!(v, Value::Tree(_) | Value::List(_)));
    out.push('[');
    for (i, value) in values.iter().enumerate() {
        match is_nested {
            true => open_line(out, i, depth + 1),
            false if i > 0 => out.push_str(", "),
            false => {}
        }
        write(out, value, depth + 1);
    }
    if is_nested {
        close_line(out, depth);
    }
    out.push(']');
}

fn write(out: &mut String, value: &Value, depth: usize) {
    match value {
        Value::Number(x) => *out += &number(*x),
        Value::Text(t) => *out += &text(t),
        Value::Flag(f) => *out += if *f { "true" } else { "false" },
        Value::List(values) => list(out, values, depth),
        Value::Tree(report) => tree(out, report, depth),
    }
}

fn open_line(out: &mut String, i: usize, depth: usize) {
    if i > 0 {
        out.push(',');
    }
    close_line(out, depth);
}

fn close_line(out: &mut String, depth: usize) {
    out.push('\n');
    *out += &"  ".repeat(depth);
}

/// The shortest digits that read back to the same number.
fn number(x: f64) -> String {
    match x {
        _ if !x.is_finite() => "null".to_owned(),
        _ if x.fract() == 0.0 && x.abs() < 9e15 => format!("{}", x as i64),
        _ => serde_json::Value::from(x).to_string(),
    }
}

fn text(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_reads_as_it_was_set() {
        let mut inner = Report::default();
        inner
            .set("vertices", 4812_usize)
            .set("stretch", 0.031)
            .set("lost", f64::NAN);
        let mut report = Report::default();
        report
            .set("version", "0.1.0 \"β\"\n")
            .set("clean", true)
            .set("garment", inner);
        report.set(
            "sizes",
            vec![
                Value::from(1.0),
                Value::from(-2.5e-9),
                Value::from(f64::INFINITY),
            ],
        );
        report.set("none", vec![]).set("empty", Report::default());
        let want = r#"{
  "version": "0.1.0 \"β\"\n",
  "clean": true,
  "garment": {
    "vertices": 4812,
    "stretch": 0.031,
    "lost": null
  },
  "sizes": [1, -2.5e-9, null],
  "none": [],
  "empty": {}
}
"#;
        assert_eq!(report_json(&report), want);
    }

    #[test]
    fn every_number_reads_back_to_the_same_bits() {
        for x in [
            0.1,
            -0.0,
            1e300,
            5e-324,
            9007199254740993.0,
            1.0 / 3.0,
            -123456.0,
            f64::MAX,
        ] {
            let mut report = Report::default();
            report.set("x", x);
            let json: serde_json::Value =
                serde_json::from_str(&report_json(&report)).expect("JSON");
            assert_eq!(json["x"].as_f64(), Some(x));
        }
    }
}
