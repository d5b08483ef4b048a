//! From names to clothes: what is in the wardrobe, and how an outfit is put together.

use glam::DVec2;
use muslin_body::{Avatar, Figure, names};
use muslin_garment::{Dress, Fabric, Garment, GarmentError, Recipe, Skirt, Tee, Trousers};
use muslin_geom::Part;

use rayon::prelude::*;

use crate::brought;
use crate::dress::asked_shape;
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::hero::Hero;
use crate::options::{DressOptions, Wear};
use crate::size::{CutFor, Wearer};

/// A garment in a fabric.
#[derive(Clone, Debug)]
pub struct Piece {
    /// What was cut.
    pub garment: Garment,
    /// From what.
    pub fabric: Fabric,
    /// SHA-256 of the file it was read from; none for the wardrobe's own.
    pub sha256: Option<String>,
}

/// What is worn, innermost first.
#[derive(Clone, Debug)]
pub struct Outfit {
    /// The garments.
    pub pieces: Vec<Piece>,
    /// Whom they are cut for, where that is not who wears them.
    pub(crate) cut_for: Option<CutFor>,
}

/// An entry of the wardrobe.
pub(crate) struct Entry {
    pub name: &'static str,
    pub says: &'static str,
    /// The fabric it is made of unless another is asked for.
    pub fabric: &'static str,
    pub recipe: fn(&DressOptions) -> Recipe,
}

/// Sleeve length of a long-sleeved shirt: beyond the wrist (2) as it is cut, for it is taken up as it hangs.
const LONG_SLEEVE: f64 = 2.1;
/// Share of a short sleeve's room that it has where it ends.
const LONG_CUFF: f64 = 0.5;
/// Leg length of shorts: a little above the knee.
const SHORT_LEG: f64 = 0.45;

/// What there is to wear.
pub(crate) const WARDROBE: [Entry; 6] = [
    Entry {
        name: "tee",
        says: "t-shirt with short sleeves and a crew neck",
        fabric: "cotton-jersey",
        recipe: |o| Recipe::Tee(tee(o)),
    },
    Entry {
        name: "long-sleeve",
        says: "t-shirt with long sleeves",
        fabric: "cotton-jersey",
        recipe: |o| {
            let short = tee(o);
            Recipe::Tee(Tee {
                sleeve: LONG_SLEEVE,
                cuff_ease: LONG_CUFF * short.cuff_ease,
                ..short
            })
        },
    },
    Entry {
        name: "trousers",
        says: "straight trousers, held at the waist",
        fabric: "wool-suiting",
        recipe: |o| Recipe::Trousers(trousers(o)),
    },
    Entry {
        name: "shorts",
        says: "trousers that end above the knee",
        fabric: "cotton-shirting",
        recipe: |o| {
            Recipe::Trousers(Trousers {
                leg: SHORT_LEG,
                ..trousers(o)
            })
        },
    },
    Entry {
        name: "skirt",
        says: "flared skirt to the knee, held at the waist",
        fabric: "cotton-shirting",
        recipe: |o| {
            Recipe::Skirt(Skirt {
                edge: o.edge,
                ..Skirt::new(o.cut)
            })
        },
    },
    Entry {
        name: "dress",
        says: "dress with short sleeves, taken in at the waist, to the knee",
        fabric: "cotton-jersey",
        recipe: |o| {
            Recipe::Dress(Dress {
                top: tee(o),
                ..Dress::new(o.cut)
            })
        },
    },
];

/// What was cut beforehand, by name, as `cargo xtask assets garments` writes it.
const CUT: [(&str, &[u8]); 6] = [
    ("tee", include_bytes!("../../../assets/wardrobe/tee.cut")),
    (
        "long-sleeve",
        include_bytes!("../../../assets/wardrobe/long-sleeve.cut"),
    ),
    (
        "trousers",
        include_bytes!("../../../assets/wardrobe/trousers.cut"),
    ),
    (
        "shorts",
        include_bytes!("../../../assets/wardrobe/shorts.cut"),
    ),
    (
        "skirt",
        include_bytes!("../../../assets/wardrobe/skirt.cut"),
    ),
    (
        "dress",
        include_bytes!("../../../assets/wardrobe/dress.cut"),
    ),
];

/// Every garment of the wardrobe as it is cut unless something else is asked for, by name: the bytes of
/// [`Garment::encode`], which `cargo xtask assets garments` keeps, so that nobody waits for scissors.
pub fn cut_beforehand() -> Result<Vec<(&'static str, Vec<u8>)>, Failure> {
    let avatar = Avatar::embedded().map_err(|e| body_failure(&e))?;
    let options = DressOptions::default();
    let one = |entry: &Entry| {
        let fault = |e: GarmentError| garment_failure(entry, &e);
        let garment = Garment::make(&avatar, &(entry.recipe)(&options)).map_err(fault)?;
        let bytes = garment.encode(&avatar).map_err(fault)?;
        Ok((entry.name, bytes.expect("it was cut")))
    };
    WARDROBE.par_iter().map(one).collect()
}

/// The garment that an entry stands for: as it was cut beforehand, if that is what is asked for.
fn cut(avatar: &Avatar, entry: &Entry, options: &DressOptions) -> Result<Garment, GarmentError> {
    let recipe = (entry.recipe)(options);
    if let Some((_, bytes)) = CUT.iter().find(|c| c.0 == entry.name)
        && let Some(garment) = Garment::decode(avatar, &recipe, bytes)?
    {
        return Ok(garment);
    }
    Garment::make(avatar, &recipe)
}

fn garment_failure(entry: &Entry, e: &GarmentError) -> Failure {
    Failure::new(Exit::Invalid, "garment", e.to_string()).at(entry.name)
}

fn tee(options: &DressOptions) -> Tee {
    Tee {
        edge: options.edge,
        ..Tee::new(options.cut)
    }
}

/// Legs are long and plain: their triangles may be this much larger than a shirt's.
const LEG_EDGE: f64 = 1.2;

fn trousers(options: &DressOptions) -> Trousers {
    let edge = (LEG_EDGE * options.edge).min(0.025);
    Trousers {
        edge,
        ..Trousers::new(options.cut)
    }
}

impl Outfit {
    /// Cuts what the options ask for; warnings about fabrics go to `warn`.
    pub fn make(
        avatar: &Avatar,
        options: &DressOptions,
        mut warn: impl FnMut(&str),
    ) -> Result<Self, Failure> {
        if options.outfit.is_empty() {
            let what = "no garment to wear";
            return Err(
                Failure::new(Exit::Usage, "no-garment", what).hint("name one with --garment")
            );
        }
        let cut = options.outfit.par_iter();
        let pieces = cut
            .map(|wear| piece(avatar, wear, options))
            .collect::<Result<Vec<_>, _>>()?;
        let (pieces, told): (Vec<Vec<Piece>>, Vec<Vec<String>>) = pieces.into_iter().unzip();
        let pieces = pieces.concat();
        told.iter().flatten().for_each(|w| warn(w));
        pieces
            .iter()
            .flat_map(|p| p.fabric.warnings())
            .for_each(|w| warn(&w));
        Ok(Self {
            pieces,
            cut_for: None,
        })
    }

    /// As [`Outfit::make`], in the size that the options ask for, if they do, for the wearer that they ask
    /// for: our own body, or the character in whose likeness `avatar` is, for whom clothes are cut on ours.
    pub(crate) fn make_for(
        (avatar, hero): (&Avatar, Option<&Hero>),
        options: &DressOptions,
        warn: impl FnMut(&str),
    ) -> Result<Self, Failure> {
        let outfit = Self::make(hero.map_or(avatar, |h| &h.base), options, warn)?;
        if options.size.is_none() && hero.is_none() {
            return Ok(outfit);
        }
        let shape = &asked_shape(avatar, options)?;
        let figure = &avatar.figure(shape).map_err(|e| body_failure(&e))?;
        let base = hero.map(|h| &h.base);
        let who = Wearer {
            avatar,
            shape,
            figure,
            base,
        };
        match options.size {
            Some(_) => outfit.sized(who, options),
            None => outfit.graded(avatar, (figure, figure)),
        }
    }

    /// The same in the size that the options ask for, if they do, for this wearer.
    pub(crate) fn sized(self, who: Wearer<'_>, options: &DressOptions) -> Result<Self, Failure> {
        match options.size {
            Some(size) => self.for_whom(who.avatar, Some(CutFor::size(who, size)?)),
            None => Ok(self),
        }
    }

    /// The same cut for somebody else than its wearer, if that is who is named.
    pub(crate) fn for_whom(
        self,
        avatar: &Avatar,
        cut_for: Option<CutFor>,
    ) -> Result<Self, Failure> {
        let own = match &cut_for {
            Some(cut) => self.graded(avatar, (&cut.figure, cut.held_by()))?,
            None => self,
        };
        Ok(Self { cut_for, ..own })
    }

    /// The same with garments of files in the size of a figure, waistbands in that of who holds them.
    fn graded(mut self, avatar: &Avatar, sizes: (&Figure, &Figure)) -> Result<Self, Failure> {
        let one = |mut piece: Piece| {
            let name = piece.garment.name.clone();
            let graded = piece.garment.graded(avatar, sizes);
            let fault = |e: GarmentError| Failure::new(Exit::Invalid, "garment", e.to_string());
            piece.garment = graded.map_err(|e| fault(e).at(name))?;
            Ok(piece)
        };
        self.pieces = self.pieces.into_iter().map(one).collect::<Result<_, _>>()?;
        Ok(self)
    }

    /// What each garment is called in results: by its name as files have it, and by its name and a number where that is
    /// taken, as the body's is.
    pub fn names(&self) -> Vec<String> {
        named_apart(self.pieces.iter().map(|p| p.garment.name.as_str()))
    }

    /// What is to be said where it is cut for somebody far slimmer than its wearer.
    pub(crate) fn tight(&self) -> Option<String> {
        self.cut_for.as_ref().and_then(CutFor::tight)
    }

    /// Each garment's share of the vertices and triangles of all.
    pub fn parts(&self) -> Vec<Part> {
        let (mut vert, mut face) = (0, 0);
        let part = |(piece, name): (&Piece, String)| {
            let (v, f) = (piece.garment.n_verts(), piece.garment.faces.len());
            let (verts, faces) = (vert..vert + v, face..face + f);
            (vert, face) = (verts.end, faces.end);
            Part { name, verts, faces }
        };
        self.pieces.iter().zip(self.names()).map(part).collect()
    }

    /// Pattern coordinates of every face's corners [m], x weft, y warp, of pieces as large as they are cut for who wears
    /// them: every face's shape there is in `rest` [m].
    pub fn uv(&self, rest: &[[DVec2; 3]]) -> Vec<[DVec2; 3]> {
        let mut all = Vec::with_capacity(rest.len());
        for garment in self.pieces.iter().map(|p| &p.garment) {
            let cut = &rest[all.len()..all.len() + garment.uv.len()];
            let scale = garment.larger(cut);
            all.extend(garment.uv.iter().map(|face| face.map(|p| p * scale)));
        }
        all
    }

    /// Whether every fabric has a strain limit, so that a stretch figure counts.
    pub fn limit(&self) -> Option<f64> {
        let limits = self.pieces.iter().map(|p| p.fabric.strain_limit);
        limits.reduce(|a, b| Some(a?.max(b?))).flatten()
    }
}

/// Cuts or loads what is asked for; also gives what there is to warn of.
fn piece(
    avatar: &Avatar,
    wear: &Wear,
    options: &DressOptions,
) -> Result<(Vec<Piece>, Vec<String>), Failure> {
    let fabric = |usual: &str| fabric::find(wear.fabric.as_deref().unwrap_or(usual));
    if brought::is_file(&wear.garment) {
        let (fabric, said) = fabric(brought::FABRIC)?;
        let file = brought::load(avatar, &wear.garment, options.edge)?;
        let mut made = (Vec::new(), file.warnings);
        made.1.extend(said);
        for garment in file.garments {
            let piece = Piece {
                garment,
                fabric: fabric.clone(),
                sha256: Some(file.sha256.clone()),
            };
            let (piece, told) = brought::rest(avatar, piece)?;
            made.0.push(piece);
            made.1.extend(told);
        }
        return Ok(made);
    }
    let entry = entry(&wear.garment)?;
    let (fabric, said) = fabric(entry.fabric)?;
    let mut garment = cut(avatar, entry, options).map_err(|e| garment_failure(entry, &e))?;
    entry.name.clone_into(&mut garment.name);
    let piece = Piece {
        garment,
        fabric,
        sha256: None,
    };
    Ok((vec![piece], said))
}

fn entry(name: &str) -> Result<&'static Entry, Failure> {
    let asked = name.trim().to_lowercase();
    WARDROBE.iter().find(|e| e.name == asked).ok_or_else(|| {
        let near = names::nearest(&asked, WARDROBE.iter().map(|e| e.name));
        let hint = format!(
            "did you mean {}? `muslin list garments` shows all; files are .json or .obj",
            near.join(", ")
        );
        let what = format!("no garment is called {name:?}");
        Failure::new(Exit::Usage, "unknown-garment", what)
            .at("--garment")
            .hint(hint)
    })
}

/// Names for files and nodes: dots would end a file's name, and `body` is what the skin is called.
fn named_apart<'a>(garments: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut names: Vec<String> = vec!["body".into()];
    for garment in garments {
        let name = muslin_io::as_name(garment).replace('.', "-");
        let numbered = (2..).map(|n| format!("{name}-{n}"));
        let mut all = std::iter::once(name.clone()).chain(numbered);
        names.extend(all.find(|n| !names.contains(n)));
    }
    names.split_off(1)
}

#[cfg(test)]
mod tests {
    use muslin_garment::Cut;

    use super::*;

    #[test]
    fn results_are_named_apart_and_as_files_can_be() {
        let garments = ["tee", "body", "tee", "skirt.v2", "a/b:c"];
        let names = named_apart(garments.into_iter());
        assert_eq!(names, ["tee", "body-2", "tee-2", "skirt-v2", "a-b-c"]);
    }

    #[test]
    fn everything_is_cut_slim_regular_and_loose() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        for cut in [Cut::Slim, Cut::Regular, Cut::Loose] {
            let options = DressOptions {
                outfit: WARDROBE.iter().map(|e| Wear::parse(e.name)).collect(),
                cut,
                edge: 0.02,
                ..Default::default()
            };
            let made = Outfit::make(&avatar, &options, |_| {}).map(|o| o.pieces.len());
            assert!(matches!(made, Ok(6)), "{cut:?}: {made:?}");
        }
    }

    // Which way an edge flips hangs on the last digit of a sine, which other libraries round otherwise.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    #[test]
    fn what_was_cut_beforehand_is_what_would_be_cut_today() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let options = DressOptions::default();
        for entry in &WARDROBE {
            let known = cut(&avatar, entry, &options).expect("it is whole");
            let today = Garment::make(&avatar, &(entry.recipe)(&options)).expect("it can be cut");
            assert!(
                known == today,
                "{}: cargo xtask assets garments",
                entry.name
            );
        }
    }

    #[test]
    fn all_that_is_cut_beforehand_is_used() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        for entry in &WARDROBE {
            let (_, bytes) = CUT.iter().find(|c| c.0 == entry.name).expect("it is there");
            let recipe = (entry.recipe)(&DressOptions::default());
            let read = Garment::decode(&avatar, &recipe, bytes).expect("it is whole");
            let name = entry.name;
            assert!(read.is_some(), "{name}: cut from another recipe or body");
        }
    }

    #[test]
    fn a_garment_or_fabric_that_is_not_there_names_its_neighbours() {
        let fault = entry("trouser").err().expect("no such garment");
        assert_eq!(fault.exit, Exit::Usage);
        assert!(fault.hint.contains("trousers"), "{fault}");
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let wear = Wear::parse("tee:demin");
        let fault = piece(&avatar, &wear, &DressOptions::default()).expect_err("no such fabric");
        assert!(fault.to_string().contains("denim"), "{fault}");
    }

    #[test]
    fn every_entry_of_the_wardrobe_can_be_made() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let options = DressOptions {
            edge: 0.025,
            ..Default::default()
        };
        for e in &WARDROBE {
            let (made, _) = piece(&avatar, &Wear::parse(e.name), &options).expect("it can be made");
            assert!(made[0].garment.faces.len() > 500, "{}", e.name);
        }
    }
}
