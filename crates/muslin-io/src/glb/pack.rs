//! A `.gltf` and what lies beside it, made one.

use std::path::{Component, Path, PathBuf};

use serde_json::{Value, json};

use super::buffer::{Glb, int};
use crate::error::{Fault, IoError, Place};
use crate::input::{Input, mebibytes, read_file};
use crate::sniff::{Kind, is_fbx, sniff};

/// Buffers and pictures that have more bytes together are refused.
const MAX_BYTES: u64 = 512 << 20;
/// What a KTX 2 texture begins with.
const KTX2: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";

/// A file in either packing; `path`: where it is, for what lies beside it.
pub fn open(path: &Path, input: &Input) -> Result<Glb<'static>, IoError> {
    match input.bytes.starts_with(b"glTF") {
        true => Glb::owned(&input.file, input.bytes.clone()),
        false => packed(path, input),
    }
}

/// The file's JSON over one buffer that holds all its buffers and pictures.
fn packed(path: &Path, input: &Input) -> Result<Glb<'static>, IoError> {
    let mut pack = Pack {
        file: &input.file,
        folder: path.parent().unwrap_or(Path::new("")),
        bin: Vec::new(),
        most: MAX_BYTES,
    };
    if is_fbx(&input.bytes) {
        let what = "an FBX file, which is not read";
        let fault = Fault::new("fbx", &input.file, what).allowed("GLB, glTF and VRM");
        return Err(fault
            .hint("export the character as GLB, with skin and skeleton")
            .refused());
    }
    let mut json: Value = serde_json::from_slice(&input.bytes).map_err(|e| {
        let what = format!("neither a GLB nor glTF JSON: {e}");
        pack.fault("/", &what)
    })?;
    if !json["asset"]["version"]
        .as_str()
        .unwrap_or("")
        .starts_with('2')
    {
        return Err(pack.fault("/asset/version", "not glTF 2"));
    }
    pack.buffers(&mut json)?;
    pack.pictures(&mut json)?;
    json["buffers"] = json!([{ "byteLength": pack.bin.len() }]);
    Ok(Glb::of(&input.file, json, pack.bin))
}

/// A file in the packing.
struct Pack<'a> {
    file: &'a str,
    folder: &'a Path,
    bin: Vec<u8>,
    /// How large `bin` may become [bytes].
    most: u64,
}

/// Bytes behind a uri, and their media type if the uri tells it.
type Fetched = (Vec<u8>, Option<String>);

impl Pack<'_> {
    /// A fault at a place in the JSON.
    fn fault(&self, pointer: &str, what: &str) -> IoError {
        let fault = Fault::new("gltf", self.file, what).at(Place::Pointer(pointer.into()));
        fault.hint("export the character as a .glb").invalid()
    }

    fn large(&self, pointer: &str) -> IoError {
        let what = "its buffers and pictures are too large together";
        let fault = Fault::new("gltf-large", self.file, what).at(Place::Pointer(pointer.into()));
        let fault = fault.allowed(mebibytes(self.most));
        fault.hint("make its pictures smaller").refused()
    }

    /// Takes the buffers; views are then views of the one.
    fn buffers(&mut self, json: &mut Value) -> Result<(), IoError> {
        let mut starts = Vec::new();
        for (i, buffer) in list(json, "buffers").iter().enumerate() {
            let pointer = format!("/buffers/{i}");
            let uri = buffer["uri"].as_str();
            let uri = uri.ok_or_else(|| self.fault(&pointer, "a buffer without a uri"))?;
            let (bytes, _) = self.fetch(&pointer, uri)?;
            starts.push(self.add(bytes));
        }
        for view in json["bufferViews"].as_array_mut().into_iter().flatten() {
            let start = int(&view["buffer"]).and_then(|b| starts.get(b)).copied();
            let start = start.ok_or_else(|| self.fault("/bufferViews", "a view of no buffer"))?;
            let start = start.checked_add(int(&view["byteOffset"]).unwrap_or(0));
            let beyond = || self.fault("/bufferViews", "a view that reaches beyond its data");
            view["byteOffset"] = json!(start.ok_or_else(beyond)?);
            view["buffer"] = json!(0);
        }
        Ok(())
    }

    /// Takes the pictures that lie beside the file; all else that it says of them stays.
    fn pictures(&mut self, json: &mut Value) -> Result<(), IoError> {
        for i in 0..list(json, "images").len() {
            let Some(uri) = json["images"][i]["uri"].as_str().map(str::to_owned) else {
                continue;
            };
            let (bytes, told) = self.fetch(&format!("/images/{i}"), &uri)?;
            let said = json["images"][i]["mimeType"].as_str().map(str::to_owned);
            let kind = picture_kind(&bytes).map(str::to_owned).or(said).or(told);
            let n = bytes.len();
            let view = json!({ "buffer": 0, "byteOffset": self.add(bytes), "byteLength": n });
            let views = json["bufferViews"].as_array_mut();
            let views = views.ok_or_else(|| self.fault("/bufferViews", "no list of views"))?;
            views.push(view);
            let index = views.len() - 1;
            let picture = &mut json["images"][i];
            picture["bufferView"] = index.into();
            if let Some(kind) = kind {
                picture["mimeType"] = kind.into();
            }
            picture.as_object_mut().and_then(|p| p.remove("uri"));
        }
        Ok(())
    }

    /// Puts bytes at the end; where they begin.
    fn add(&mut self, bytes: Vec<u8>) -> usize {
        let start = self.bin.len();
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        start
    }

    /// What is behind a uri: data in itself, or a file below the folder.
    fn fetch(&self, pointer: &str, uri: &str) -> Result<Fetched, IoError> {
        let room = self.most.saturating_sub(self.bin.len() as u64);
        match fetch((self.folder, room), uri) {
            Ok((bytes, _)) if bytes.len() as u64 > room => Err(self.large(pointer)),
            Err(Some(e)) if e.code() == "file-large" => Err(self.large(pointer)),
            Err(None) => Err(self.fault(pointer, "a uri that is not below the file's folder")),
            Err(Some(e)) => Err(e),
            Ok(fetched) => Ok(fetched),
        }
    }
}

fn list<'a>(json: &'a Value, key: &str) -> &'a [Value] {
    json[key].as_array().map_or(&[], Vec::as_slice)
}

/// The media type of a picture by its first bytes.
fn picture_kind(bytes: &[u8]) -> Option<&'static str> {
    match sniff(bytes) {
        Kind::Png => Some("image/png"),
        Kind::Jpeg => Some("image/jpeg"),
        Kind::WebP => Some("image/webp"),
        _ => bytes.starts_with(KTX2).then_some("image/ktx2"),
    }
}

/// The bytes behind a uri, files of at most `room` bytes. An error without a fault: the uri leads elsewhere.
fn fetch((folder, room): (&Path, u64), uri: &str) -> Result<Fetched, Option<IoError>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, text) = data.split_once(";base64,").ok_or(None)?;
        let kind = kind.split(';').next().filter(|k| !k.is_empty());
        return Ok((base64(text).ok_or(None)?, kind.map(str::to_owned)));
    }
    let path = PathBuf::from(unescaped(uri).ok_or(None)?);
    if path
        .components()
        .any(|c| !matches!(c, Component::Normal(_) | Component::CurDir))
    {
        return Err(None);
    }
    let read = read_file(&folder.join(path), room);
    read.map(|i| (i.bytes, None)).map_err(Some)
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
    use crate::testing::Folder;

    #[test]
    fn data_in_a_uri_is_read_and_ways_out_of_the_folder_are_not() {
        let folder = Path::new("");
        let read = |uri: &str| fetch((folder, 9), uri).ok();
        let kind = Some("application/octet-stream".to_owned());
        assert_eq!(
            read("data:application/octet-stream;base64,bXVzbGlu"),
            Some((b"muslin".to_vec(), kind))
        );
        assert_eq!(
            read("data:;base64,bXVzbGluLg=="),
            Some((b"muslin.".to_vec(), None))
        );
        for uri in [
            "../secret.bin",
            "/etc/hostname",
            "a/../../b",
            "data:;base64,a-b",
            "http:%",
            "data:x,y",
        ] {
            assert!(matches!(fetch((folder, 9), uri), Err(None)), "{uri}");
        }
        assert_eq!(unescaped("a%20b.bin").as_deref(), Some("a b.bin"));
    }

    /// Text of `{"asset":{"version":"2.0"}, ...}` as a file.
    fn text(json: &Value) -> Input {
        let mut json = json.clone();
        json["asset"] = json!({ "version": "2.0" });
        Input {
            file: "a.gltf".into(),
            bytes: json.to_string().into_bytes(),
        }
    }

    #[test]
    fn pictures_keep_what_the_file_says_of_them_and_are_called_what_they_are() {
        let folder = Folder::new("gltf-pictures");
        let webp = b"RIFF\x04\0\0\0WEBPVP8 ";
        let files: [(&str, &[u8]); 5] = [
            ("a.jpg", webp),
            ("b.jpg", KTX2),
            ("c.png", b"\xff\xd8\xff\xe0"),
            ("d.dds", b"DDS "),
            ("e.dds", b"DDS "),
        ];
        files.iter().for_each(|(name, bytes)| {
            folder.put(name, bytes);
        });
        let image = |(name, _): &(&str, &[u8])| json!({ "uri": name, "name": name, "extras": { "layer": 3 } });
        let mut images: Vec<Value> = files.iter().map(image).collect();
        images[3]["mimeType"] = json!("image/vnd-ms.dds");
        images.push(json!({ "uri": "data:image/x-own;base64,bXVzbGlu", "name": "f" }));
        let json = json!({ "images": images, "bufferViews": [] });
        let packed = packed(&folder.path().join("a.gltf"), &text(&json)).expect("whole");
        let kept = packed.list("images");
        let kinds: Vec<Option<&str>> = kept.iter().map(|i| i["mimeType"].as_str()).collect();
        assert_eq!(
            kinds,
            [
                Some("image/webp"),
                Some("image/ktx2"),
                Some("image/jpeg"),
                Some("image/vnd-ms.dds"),
                None,
                Some("image/x-own"),
            ]
        );
        for (i, image) in kept.iter().enumerate() {
            assert!(image["uri"].is_null() && image["bufferView"] == i);
            assert_eq!(image["name"], images[i]["name"]);
            assert_eq!(image["extras"], images[i]["extras"]);
        }
        let (bytes, _) = packed.view(&json!(0)).expect("a picture");
        assert_eq!(bytes, webp);
    }

    #[test]
    fn what_lies_beside_a_file_is_limited_as_a_whole() {
        let folder = Folder::new("gltf-large");
        folder.put("a.bin", b"muslin");
        let pack = |most: u64| Pack {
            file: "a.gltf",
            folder: folder.path(),
            bin: Vec::new(),
            most,
        };
        for uri in ["a.bin", "data:;base64,bXVzbGlu"] {
            let mut json = json!({ "buffers": [{ "uri": uri }, { "uri": uri }] });
            assert!(pack(14).buffers(&mut json).is_ok(), "{uri}");
            let fault = pack(13).buffers(&mut json).expect_err("a byte too many");
            assert_eq!((fault.code(), fault.exit_code()), ("gltf-large", 4));
            assert!(fault.to_string().contains("/buffers/1"), "{fault}");
        }
    }

    #[test]
    fn a_view_beyond_all_numbers_is_an_error() {
        let buffer = json!({ "uri": "data:;base64,bXVzbGlu" });
        let view = |offset: u64| json!({ "buffer": 1, "byteOffset": offset, "byteLength": 6 });
        let read = |offset: u64| {
            let json = json!({ "buffers": [buffer, buffer], "bufferViews": [view(offset)] });
            packed(Path::new("a.gltf"), &text(&json))
        };
        let whole = read(0).expect("whole");
        assert_eq!(whole.view(&json!(0)).map(|v| v.0), Some(&b"muslin"[..]));
        let fault = read(u64::MAX).expect_err("no such place");
        assert!(fault.to_string().contains("beyond its data"), "{fault}");
    }
}
