//! Materials that come as one file: U3MA, a ZIP archive of a U3M, its physics and its pictures.

use super::{CAP, FabricFile, text_of, u3m, without_physics};
use crate::error::{Fault, IoError};
use crate::zip::{Member, members, unpack};

/// The fabric of the first file in the archive that says how it moves: its U3M files, then its other JSON.
pub fn read(file: &str, bytes: &[u8]) -> Result<FabricFile, IoError> {
    let fault = |what: String| Fault::new("fabric-archive", file, what);
    let bad = |what: String| fault(what).invalid();
    let all = members(bytes).map_err(|e| e.told(fault))?;
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
        let data = unpack(bytes, member).map_err(|e| bad(format!("{:?}: {e}", member.name)))?;
        match u3m(&name, text_of(&name, &data)?) {
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
