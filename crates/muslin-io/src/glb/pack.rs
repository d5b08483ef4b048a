//! A `.gltf` and what lies beside it, made one.

use std::path::{Component, Path, PathBuf};

use serde_json::{Value, json};

use super::buffer::{Glb, int};
use crate::error::{Fault, IoError, Place};
use crate::input::{Input, read_file};

/// Side files with more bytes are refused.
const MAX_BYTES: u64 = 512 << 20;

/// The file's JSON over one buffer that holds all its buffers and pictures.
pub fn packed(path: &Path, input: &Input) -> Result<Glb<'static>, IoError> {
    let fault = |pointer: String, what: &str| {
        let fault = Fault::new("gltf", &input.file, what).at(Place::Pointer(pointer));
        fault.hint("export the character as a .glb").invalid()
    };
    let mut json: Value = serde_json::from_slice(&input.bytes).map_err(|e| {
        let what = format!("neither a GLB nor glTF JSON: {e}");
        fault("/".into(), &what)
    })?;
    if !json["asset"]["version"]
        .as_str()
        .unwrap_or("")
        .starts_with('2')
    {
        return Err(fault("/asset/version".into(), "not glTF 2"));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut bin = Vec::new();
    let mut starts = Vec::new();
    for (i, buffer) in list(&json, "buffers").iter().enumerate() {
        let pointer = format!("/buffers/{i}");
        let uri = buffer["uri"]
            .as_str()
            .ok_or_else(|| fault(pointer.clone(), "a buffer without a uri"))?;
        let bytes = fetch(folder, uri).map_err(|e| {
            e.unwrap_or_else(|| fault(pointer, "a uri that is not below the file's folder"))
        })?;
        starts.push(bin.len());
        bin.extend(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
    }
    for view in json["bufferViews"].as_array_mut().into_iter().flatten() {
        let start = int(&view["buffer"]).and_then(|b| starts.get(b)).copied();
        let start = start.ok_or_else(|| fault("/bufferViews".into(), "a view of no buffer"))?;
        view["byteOffset"] = json!(start + int(&view["byteOffset"]).unwrap_or(0));
        view["buffer"] = json!(0);
    }
    let n_images = list(&json, "images").len();
    for i in 0..n_images {
        let Some(uri) = json["images"][i]["uri"].as_str().map(str::to_owned) else {
            continue;
        };
        let pointer = format!("/images/{i}");
        let bytes = fetch(folder, &uri).map_err(|e| {
            e.unwrap_or_else(|| fault(pointer, "a uri that is not below the file's folder"))
        })?;
        let view = json!({ "buffer": 0, "byteOffset": bin.len(), "byteLength": bytes.len() });
        let kind = if bytes.starts_with(b"\x89PNG") {
            "image/png"
        } else {
            "image/jpeg"
        };
        bin.extend(bytes);
        bin.resize(bin.len().next_multiple_of(4), 0);
        let views = json["bufferViews"].as_array_mut();
        let views = views.ok_or_else(|| fault("/bufferViews".into(), "no list of views"))?;
        views.push(view);
        let index = views.len() - 1;
        json["images"][i] = json!({ "bufferView": index, "mimeType": kind });
    }
    json["buffers"] = json!([{ "byteLength": bin.len() }]);
    Ok(Glb::of(&input.file, json, bin))
}

fn list<'a>(json: &'a Value, key: &str) -> &'a [Value] {
    json[key].as_array().map_or(&[], Vec::as_slice)
}

/// The bytes behind a uri: data in itself, or a file below the folder. An error without a fault: the
/// uri leads elsewhere.
fn fetch(folder: &Path, uri: &str) -> Result<Vec<u8>, Option<IoError>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data.split_once(";base64,").ok_or(None)?;
        return base64(text).ok_or(None);
    }
    let path = PathBuf::from(unescaped(uri).ok_or(None)?);
    if path
        .components()
        .any(|c| !matches!(c, Component::Normal(_) | Component::CurDir))
    {
        return Err(None);
    }
    let read = read_file(&folder.join(path), MAX_BYTES);
    read.map(|i| i.bytes).map_err(Some)
}

/// Percent signs resolved.
fn unescaped(uri: &str) -> Option<String> {
    let mut out = Vec::new();
    let mut bytes = uri.bytes();
    while let Some(b) = bytes.next() {
        if b != b'%' {
            out.push(b);
            continue;
        }
        let digits = [bytes.next()?, bytes.next()?];
        out.push(u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?);
    }
    String::from_utf8(out).ok()
}

/// Base64 (RFC 4648, section 4) with or without padding; none where a character is no digit.
fn base64(text: &str) -> Option<Vec<u8>> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => Some(c - b'A'),
        b'a'..=b'z' => Some(c - b'a' + 26),
        b'0'..=b'9' => Some(c - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None,
    };
    let (mut word, mut bits, mut out) = (0u32, 0, Vec::new());
    for c in text.trim_end_matches('=').bytes() {
        word = word << 6 | u32::from(digit(c)?);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            out.push((word >> bits) as u8);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_in_a_uri_is_read_and_ways_out_of_the_folder_are_not() {
        let folder = Path::new("");
        let read = |uri: &str| fetch(folder, uri).ok();
        assert_eq!(
            read("data:application/octet-stream;base64,bXVzbGlu"),
            Some(b"muslin".to_vec())
        );
        assert_eq!(read("data:;base64,bXVzbGluLg=="), Some(b"muslin.".to_vec()));
        for uri in [
            "../secret.bin",
            "/etc/hostname",
            "a/../../b",
            "data:;base64,a-b",
            "http:%",
            "data:x,y",
        ] {
            assert!(matches!(fetch(folder, uri), Err(None)), "{uri}");
        }
        assert_eq!(unescaped("a%20b.bin").as_deref(), Some("a b.bin"));
    }
}
