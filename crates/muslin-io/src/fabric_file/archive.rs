//! Materials that come as one file: U3MA, a ZIP archive of a U3M, its physics and its pictures.

use super::{CAP, FabricFile, u3m, without_physics};
use crate::error::{Fault, IoError, Place};
use crate::npz::zip::{Member, members, unpack};

/// What archives begin with.
const MAGIC: &[u8] = b"PK\x03\x04";

/// Whether these are the bytes of an archive.
pub fn is_archive(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The fabric of the first file in the archive that says how it moves: its U3M files, then its other JSON.
pub fn read(file: &str, bytes: &[u8]) -> Result<FabricFile, IoError> {
    let bad = |what: String| Fault::new("fabric-archive", file, what).invalid();
    let all = members(bytes).map_err(bad)?;
    let ends = |end: &'static str| {
        let ending = move |m: &&Member| m.name.to_lowercase().ends_with(end);
        all.iter().filter(ending)
    };
    let mut without = Vec::new();
    for member in ends(".u3m").chain(ends(".json")) {
        let name = format!("{file}/{}", member.name);
        if member.size > CAP {
            let fault = Fault::new("fabric-archive", &name, "this is too large for a material");
            let fault = fault.found(format!("{} bytes", member.size));
            return Err(fault.allowed(format!("{CAP} bytes")).refused());
        }
        let text = unpack(bytes, member).map_err(|e| bad(format!("{:?}: {e}", member.name)))?;
        let text = String::from_utf8(text).map_err(|e| {
            let at = Place::Byte(e.utf8_error().valid_up_to() as u64);
            let fault = Fault::new("fabric-text", &name, "this is not text in UTF-8");
            fault.at(at).invalid()
        })?;
        match u3m(&name, &text) {
            Err(e) if e.code() == "fabric-physics" => without.push(member.name.as_str()),
            read => return read,
        }
    }
    let fault = match without.is_empty() {
        true => Fault::new("fabric-archive", file, "no U3M material is in the archive"),
        false => without_physics(file).found(without.join(", ")),
    };
    Err(fault.hint("export it with physics (U3M 1.1)").invalid())
}
