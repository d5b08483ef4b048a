//! Garments that users bring: files in place of names.

use std::path::Path;

use muslin_body::{Avatar, Cores, Figure, Pose, Shape};
use muslin_garment::{Garment, GarmentError, Worn};
use muslin_io::{garmentcode, read_file, read_obj};
use muslin_sim::{Options, Settled, SimError, drape};

use crate::drape::{cloth, places, put_on};
use crate::dress::file_failure;
use crate::failure::{Exit, Failure};
use crate::figure::{body_failure, body_frame};
use crate::hero::{Hero, standing};
use crate::options::DressOptions;
use crate::outfit::{Outfit, Piece};

/// The garments of a file, innermost first, and what there is to say about them.
pub(crate) struct Brought {
    pub garments: Vec<Garment>,
    pub sha256: String,
    pub warnings: Vec<String>,
}

/// Largest garment file [bytes].
const MAX_BYTES: u64 = 64 << 20;
/// What such files are made of unless a fabric is named.
pub(crate) const FABRIC: &str = "cotton-shirting";
/// A seam this wide after sewing did not close [m].
const OPEN: f64 = 5e-3;
/// Strain left from sewing beyond which a garment counts as tight.
const TIGHT: f64 = 0.12;

/// Whether an asked garment is a file rather than a name of the wardrobe.
pub(crate) fn is_file(asked: &str) -> bool {
    kind(numbered(asked).0).is_some() || asked.contains(['/', '\\'])
}

/// The file that is asked for, and which of its pieces, from 1, if only one: `suit.obj#2`.
pub(crate) fn numbered(asked: &str) -> (&str, Option<usize>) {
    match asked.rsplit_once('#') {
        Some((file, n)) if !Path::new(asked).exists() => match n.parse() {
            Ok(n) => (file, Some(n)),
            Err(_) => (asked, None),
        },
        _ => (asked, None),
    }
}

fn kind(asked: &str) -> Option<String> {
    let kind = Path::new(asked).extension()?.to_str()?.to_lowercase();
    ["json", "obj"].contains(&kind.as_str()).then_some(kind)
}

/// Steps in which a garment comes to rest on a body that it is new to, at most.
const STEPS: usize = 30;

/// Lets a new garment come to rest on the default body; says what it could not mend.
pub(crate) fn rest(avatar: &Avatar, piece: Piece) -> Result<(Piece, Vec<String>), Failure> {
    let figure = avatar
        .figure(&Shape::default())
        .map_err(|e| body_failure(&e))?;
    let outfit = Outfit {
        pieces: vec![piece],
        cut_for: None,
    };
    let worn = put_on(avatar, &outfit, &figure)?;
    let settled = led((avatar, &figure), &Pose::rest(avatar), (&outfit, &worn))?;
    let mut told = Vec::new();
    let (inside, crossed) = (settled.body_intersections, settled.self_crossings);
    let mut pieces = outfit.pieces;
    let mut piece = pieces.swap_remove(0);
    if inside + crossed > 0 {
        told.push(format!(
            "{} does not lie clean on the standing body: it meets it in {inside} places and itself in {crossed}",
            piece.garment.name
        ));
    }
    let garment = piece.garment.resting(avatar, settled.verts);
    piece.garment = garment.map_err(|e| Failure::new(Exit::Invalid, "garment", e.to_string()))?;
    Ok((piece, told))
}

/// An outfit as it lies around a figure that `stands` to be dressed ([`Avatar::dressing`]): put on, and where a
/// garment of a file lies around somebody else than the default body, or over other cloth, led to rest. What is
/// taught and played begins there.
pub(crate) fn dressed(
    avatar: &Avatar,
    outfit: &Outfit,
    (figure, stands): (&Figure, &(Pose, Figure)),
) -> Result<Vec<Worn>, Failure> {
    let (pose, stood) = stands;
    let mut worn = put_on(avatar, outfit, stood)?;
    if outfit.pieces.iter().all(|p| p.sha256.is_none()) || lies(avatar, outfit, stood)? {
        return Ok(worn);
    }
    let settled = led((avatar, figure), pose, (outfit, &worn))?;
    for (worn, part) in worn.iter_mut().zip(outfit.parts()) {
        worn.verts = settled.verts[part.verts].to_vec();
    }
    Ok(worn)
}

/// Somebody as the options have them, and their outfit as it lies around them when it is put on ([`dressed`]).
pub(crate) fn standing_in(
    (avatar, hero): (&Avatar, Option<&Hero>),
    options: &DressOptions,
) -> Result<(Figure, Outfit, Vec<Worn>), Failure> {
    let figure = standing(avatar, hero, options)?.figure;
    let outfit = Outfit::make_for((avatar, hero), options, |_| {})?;
    let stands = avatar.dressing(&figure);
    let worn = dressed(avatar, &outfit, (&figure, &stands))?;
    Ok((figure, outfit, worn))
}

/// Whether a garment of a file lies as it came to rest when it was read: alone, on the default body.
pub(crate) fn lies(avatar: &Avatar, outfit: &Outfit, stood: &Figure) -> Result<bool, Failure> {
    let standard = avatar.standard().map_err(|e| body_failure(&e))?;
    let alone = outfit.pieces.len() == 1 && outfit.cut_for.is_none();
    Ok(alone && stood.verts == standard.verts)
}

/// What is put on, at rest on a standing figure.
pub(crate) fn led(
    (avatar, figure): (&Avatar, &Figure),
    pose: &Pose,
    (outfit, worn): (&Outfit, &[Worn]),
) -> Result<Settled, Failure> {
    let cores = Cores::new(avatar, figure);
    let body = body_frame(avatar, &avatar.pose(figure, pose), &cores);
    let cloth = cloth(outfit, worn);
    let start = places(worn);
    let options = Options {
        last_steps: STEPS,
        ..Options::default()
    };
    let numbers = |e: SimError| Failure::new(Exit::Numbers, "garment", e.to_string());
    let body = (&[body][..], avatar.collision_faces());
    drape(&cloth, &start, body, &options).map_err(numbers)
}

/// Reads and makes the garments in a file, or that of them which is `asked` for by number, with triangles of about
/// `edge` [m].
pub(crate) fn load(avatar: &Avatar, asked: &str, edge: f64) -> Result<Brought, Failure> {
    let (path, number) = numbered(asked);
    let mut all = read(avatar, path, edge)?;
    let Some(number) = number else {
        return Ok(all);
    };
    let names: Vec<String> = all.garments.iter().map(|g| g.name.clone()).collect();
    let (n, own) = (names.len(), format!("{}-{number}", name(path)));
    all.garments
        .retain(|g| g.name == own || n == 1 && number == 1);
    if all.garments.is_empty() {
        let what = format!("it has no piece {number}");
        return Err(Failure::new(Exit::Usage, "no-such-piece", what)
            .at(path)
            .hint(format!("it holds {}", names.join(", "))));
    }
    Ok(all)
}

fn read(avatar: &Avatar, path: &str, edge: f64) -> Result<Brought, Failure> {
    let input = read_file(Path::new(path), MAX_BYTES).map_err(|e| file_failure(&e))?;
    let name = name(path);
    let sha256 = input.sha256();
    let fault = |e: GarmentError| {
        let hint = match &e {
            GarmentError::Outline { .. } => {
                "draw the outline so that its edges only meet at corners"
            }
            GarmentError::Seam { .. } => "check which edges are sewn, and the right_wrong marks",
            _ => "",
        };
        Failure::new(Exit::Invalid, "garment", e.to_string())
            .at(path)
            .hint(hint)
    };
    match kind(path).as_deref() {
        Some("json") => {
            let read =
                garmentcode::read(&input.file, &input.bytes).map_err(|e| file_failure(&e))?;
            let sewn = Garment::sew(avatar, &read.pattern, (&name, edge)).map_err(fault)?;
            let mut warnings = read.warnings;
            warnings.extend(sewn.warnings);
            if sewn.gap > OPEN {
                return Err(open(path, sewn.gap));
            }
            if sewn.strain > TIGHT {
                warnings.push(format!(
                    "{name} is tight: sewing stretches it by {:.0} % in places",
                    sewn.strain * 100.0
                ));
            }
            Ok(Brought {
                garments: vec![sewn.garment],
                sha256,
                warnings,
            })
        }
        Some("obj") => {
            let read = read_obj(&input.file, &input.bytes).map_err(|e| file_failure(&e))?;
            let made = Garment::tailor(avatar, &read.mesh, (&name, edge)).map_err(fault)?;
            Ok(Brought {
                garments: made.garments,
                sha256,
                warnings: made
                    .warnings
                    .iter()
                    .map(|w| format!("{name}: {w}"))
                    .collect(),
            })
        }
        _ => {
            let what = "garments are read from .json (GarmentCode patterns) and .obj files";
            Err(Failure::new(Exit::Refused, "garment-kind", what).at(path))
        }
    }
}

fn open(path: &str, gap: f64) -> Failure {
    let what = format!("a seam stays open by {:.0} mm", gap * 1e3);
    Failure::new(Exit::Invalid, "open-seam", what)
        .at(path)
        .hint("the pattern is too small for the body, or its panels are placed far from it")
}

/// The file's name without folder, ending and what pattern makers append.
fn name(path: &str) -> String {
    let stem = Path::new(path).file_stem().unwrap_or_default();
    let stem = stem.to_string_lossy();
    stem.strip_suffix("_specification")
        .unwrap_or(&stem)
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_told_from_names_by_their_ending_or_folder() {
        assert!(is_file("a.json") && is_file("b/c.OBJ") && is_file("./tee"));
        assert!(is_file("suit.obj#2") && numbered("a/suit.obj#2") == ("a/suit.obj", Some(2)));
        assert_eq!(numbered("a#b.obj"), ("a#b.obj", None));
        assert!(!is_file("tee") && !is_file("long-sleeve"));
        assert_eq!(name("x/shirt_mean_specification.json"), "shirt_mean");
    }
}
