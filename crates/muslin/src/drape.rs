//! From an outfit and a body to cloth at rest: arrays for the solver, and a verdict on its answer.

use glam::DVec3;
use muslin_body::{Avatar, Figure, Part};
use muslin_energy::{hinge::Bend, membrane::Stretch};
use muslin_garment::{Fabric, Garment, Worn};
use muslin_geom::{Drape, Surface};
use muslin_sim::{
    BEYOND_LIMIT, Cloth, Frame, Material, Options, Settled, SimError, drape_along, stretch,
};

use crate::begin::begin;
use crate::failure::{Exit, Failure};
use crate::figure::Sitter;
use crate::outfit::Outfit;
use crate::wardrobe::{Known, taught};
use crate::watch::Watch;

/// An outfit at rest on a body.
#[derive(Clone, Debug)]
pub struct Dressed {
    /// The still.
    pub drape: Drape,
    /// Pattern coordinates of every face's corners [m], x weft, y warp.
    pub uv: Vec<[glam::DVec2; 3]>,
    /// How good it is.
    pub quality: Quality,
    /// Whether it started where trained garments said that they lie.
    pub taught: bool,
}

/// What a judge would measure on the delivered frame.
#[derive(Clone, Debug)]
pub struct Quality {
    /// What the solver counted.
    pub settled: Settled,
    /// For each garment: 99th percentile of its faces' stretch, and its fabric's limit.
    pub stretch: Vec<(f64, Option<f64>)>,
}

/// For cloth on the way from the rest pose.
const FROM_REST: Options = Options {
    freely: true,
    ..Options::USUAL
};
/// For cloth that is near its rest: steps twice as long, solved with handles, and no second attempt.
///
/// Five of them leave 0.005 J of a tee's energy where five usual ones leave 0.008; steps of 0.1 s or more
/// stretch single triangles twice as far as the fabric lets them.
pub(crate) const NEARLY_THERE: Options = Options {
    step: 0.06,
    iterations: 40,
    handles: true,
    first_steps: 0,
    tugs: 0,
    again: false,
    ..Options::USUAL
};
/// `n` such steps for a frame by itself; what ends with a fault is tried a second time with more care.
pub(crate) const fn to_rest(n: usize) -> Options {
    Options {
        again: true,
        last_steps: n,
        still: 0.0,
        ..NEARLY_THERE
    }
}
/// Such steps for cloth that lies where it was taught to; what needs more of them is caught somewhere.
pub(crate) const LAID: Options = Options {
    last_steps: 30,
    rounds: 1,
    ..NEARLY_THERE
};
/// For cloth that such steps left too tight, or crossing itself: it is let go once where it is.
pub(crate) const LET_GO: Options = Options { tugs: 1, ..LAID };
/// Where cloth is caught, it stretches by so much beyond its limit (1 is its length).
const CAUGHT: f64 = 0.5;
/// Largest turn of a joint in one step on the way to the pose [rad].
const TURN: f64 = 0.09;

impl Quality {
    /// What keeps the drape from being delivered, if anything.
    pub fn fault(&self, allow_crossings: bool) -> Option<Failure> {
        let s = &self.settled;
        let quality = |code, what: String, hint: &str| {
            Some(Failure::new(Exit::Quality, code, what).hint(hint))
        };
        if s.body_intersections > 0 {
            let what = format!(
                "{} pairs of cloth and body triangles meet",
                s.body_intersections
            );
            return quality("cloth-in-body", what, "try --cut loose, or a finer --edge");
        }
        if s.self_crossings > 0 && !allow_crossings {
            let what = format!("the cloth crosses itself in {} places", s.self_crossings);
            return quality(
                "cloth-in-cloth",
                what,
                "--allow-crossings writes it all the same",
            );
        }
        None
    }

    /// Whether every garment stays within its fabric's limit and one per cent.
    pub fn within_limits(&self) -> bool {
        let fits =
            |&(p99, limit): &(f64, Option<f64>)| limit.is_none_or(|l| p99 <= l + BEYOND_LIMIT);
        self.stretch.iter().all(fits)
    }

    /// Whether nothing is wrong with it.
    fn is_good(&self) -> bool {
        self.fault(false).is_none() && self.within_limits() && !self.is_caught()
    }

    /// Whether single triangles stretch far beyond every limit, where cloth is caught in a fold.
    pub fn is_caught(&self) -> bool {
        let limits = self.stretch.iter().filter_map(|s| s.1);
        self.settled.stretch_max > limits.fold(0.0, f64::max) + CAUGHT
    }

    /// The largest 99th percentile of the garments' stretch.
    pub fn stretch_p99(&self) -> f64 {
        self.stretch.iter().map(|s| s.0).fold(0.0, f64::max)
    }
}

/// Drapes an outfit on somebody: from the rest pose along a short way into the pose, then to rest.
///
/// `watch` is asked between steps whether to go on.
pub fn drape_outfit(
    avatar: &Avatar,
    outfit: &Outfit,
    sitter: &Sitter,
    watch: &Watch<'_>,
) -> Result<Dressed, Failure> {
    let worn = put_on(avatar, outfit, &sitter.figure)?;
    from_rest((avatar, sitter), (outfit, &worn), watch)
}

fn from_rest(
    (avatar, sitter): (&Avatar, &Sitter),
    (outfit, worn): (&Outfit, &[Worn]),
    watch: &Watch<'_>,
) -> Result<Dressed, Failure> {
    let start = places(worn);
    let path = sitter.path(avatar, &sitter.shares((0.0, TURN)));
    let body = (path.as_slice(), avatar.collision_faces());
    settle((outfit, worn), (&start, &[]), body, (FROM_REST, watch))
}

/// Drapes an outfit on somebody from where trained garments say that it lies in the pose, or on the way
/// to it. What comes to lie too tight there, or crosses itself, is let go; what was not taught, or
/// does not come out clean from there, is draped as [`drape_outfit`] does.
pub(crate) fn lay_outfit(
    (avatar, sitter): (&Avatar, &Sitter),
    outfit: &Outfit,
    watch: &Watch<'_>,
) -> Result<Dressed, Failure> {
    let (worn, models) = rayon::join(|| put_on(avatar, outfit, &sitter.figure), || taught(outfit));
    let worn = worn?;
    let known = models.and_then(|m| Known::new((avatar, &sitter.figure), (outfit, &worn), m));
    let laid = known.and_then(|known| {
        let rest = places(&worn);
        let still = || {
            let skin = &sitter.figure.verts[avatar.part(Part::Body)];
            Surface::new(skin, avatar.collision_faces())
        };
        let faces = cloth(outfit, &worn).faces;
        let (share, start) = begin(&faces, (&rest, still), |share| {
            let pose = sitter.on_the_way(avatar, share);
            let posed = avatar.pose(&sitter.figure, &pose);
            let skin = &posed.verts[avatar.part(Part::Body)];
            let skin = Surface::new(skin, avatar.collision_faces());
            Some((known.laid(&pose)?, skin))
        })?;
        let shares = sitter.shares((share, TURN));
        let path = sitter.path(avatar, &shares);
        let poses = |k: usize| sitter.on_the_way(avatar, shares[k]);
        let along = known.along(&path, poses);
        Some((start, path, along))
    });
    if let Some((start, path, along)) = laid {
        let body = (path.as_slice(), avatar.collision_faces());
        // What is led into the body may not come there with the skin.
        let ways = [&along[..], &[]];
        for along in &ways[usize::from(along.is_empty())..] {
            let mut dressed = settle((outfit, &worn), (&start, along), body, (LAID, watch))?;
            if !dressed.quality.is_good() && dressed.quality.settled.body_intersections == 0 {
                let here = (&path[path.len() - 1..], body.1);
                let lies = &dressed.drape.frames[0];
                dressed = settle((outfit, &worn), (lies, &[]), here, (LET_GO, watch))?;
            }
            if dressed.quality.is_good() {
                return Ok(Dressed {
                    taught: true,
                    ..dressed
                });
            }
        }
    }
    from_rest((avatar, sitter), (outfit, &worn), watch)
}

/// Solves from `start` [m] along a path of the body, and `along` [m] with it where that is known, and `watch`es.
fn settle(
    (outfit, worn): (&Outfit, &[Worn]),
    (start, along): (&[DVec3], &[Vec<DVec3>]),
    body: (&[Frame], &[[u32; 3]]),
    (options, watch): (Options, &Watch<'_>),
) -> Result<Dressed, Failure> {
    let cloth = cloth(outfit, worn);
    let any = |is: fn(&Garment) -> bool| outfit.pieces.iter().any(|p| is(&p.garment));
    let options = Options {
        handles: options.handles || any(Garment::hangs_freely),
        freely: options.freely && !any(Garment::hangs_from_the_waist),
        ..options
    };
    let go_on = watch.stepping("the cloth finds its place");
    let settled = drape_along(&cloth, (start, along), body, (&options, &go_on));
    // Where it stopped because it was asked to, that is the answer.
    watch.go_on()?;
    let settled = settled.map_err(|e| match e {
        SimError::TooTight(_) => Failure::new(Exit::Quality, "too-tight", e.to_string())
            .hint("this pose asks for a wider cut (--cut loose) or a larger --size"),
        _ => Failure::new(Exit::Numbers, "drape", e.to_string()),
    })?;
    Ok(finish(outfit, &cloth, settled))
}

/// Every garment around the body's rest pose, outside of those under it, in its size.
pub(crate) fn put_on(
    avatar: &Avatar,
    outfit: &Outfit,
    figure: &Figure,
) -> Result<Vec<Worn>, Failure> {
    let garments = outfit.pieces.iter().map(|p| p.garment.clone()).collect();
    let garments = muslin_garment::Outfit { garments };
    let on = |figure: &Figure| {
        let worn = garments.worn(avatar, figure);
        worn.map_err(|e| Failure::new(Exit::Invalid, "garment", e.to_string()))
    };
    let Some(cut) = &outfit.cut_for else {
        return on(figure);
    };
    let (own, wide) = rayon::join(|| on(figure), || on(&cut.stood));
    let worn = outfit.pieces.iter().zip(own?.into_iter().zip(wide?));
    Ok(worn.map(|(p, w)| cut.taken_over(p, w)).collect())
}

/// Where all garments are [m], one after the other.
pub(crate) fn places(worn: &[Worn]) -> Vec<DVec3> {
    worn.iter().flat_map(|w| w.verts.iter().copied()).collect()
}

/// The outfit as the solver's arrays.
pub(crate) fn cloth(outfit: &Outfit, worn: &[Worn]) -> Cloth {
    let mut cloth = Cloth::default();
    for (k, (piece, w)) in outfit.pieces.iter().zip(worn).enumerate() {
        let first = cloth.layers.len() as u32;
        cloth
            .faces
            .extend(piece.garment.faces.iter().map(|f| f.map(|i| i + first)));
        cloth.rest.extend_from_slice(&w.rest);
        cloth.materials.push(material(&piece.fabric));
        cloth
            .material_of
            .extend(piece.garment.faces.iter().map(|_| k as u32));
        cloth.layers.extend(w.verts.iter().map(|_| k as u32));
        cloth
            .pins
            .extend(piece.garment.pins.iter().map(|i| i + first));
    }
    cloth
}

/// Garment `k` alone of an outfit's cloth.
pub(crate) fn cloth_of(outfit: &Cloth, (k, part): (usize, &muslin_geom::Part)) -> Cloth {
    let own = |v: &&u32| part.verts.contains(&(**v as usize));
    let first = part.verts.start as u32;
    let faces = outfit.faces[part.faces.clone()].iter();
    let pins = outfit.pins.iter().filter(own);
    Cloth {
        faces: faces.map(|f| f.map(|v| v - first)).collect(),
        rest: outfit.rest[part.faces.clone()].to_vec(),
        materials: vec![outfit.materials[k]],
        material_of: vec![0; part.faces.len()],
        layers: vec![0; part.verts.len()],
        pins: pins.map(|v| v - first).collect(),
    }
}

/// Share of its stiffness that cloth keeps in compression at most: the rest buckles below the mesh's
/// size.
const COMPRESSION: f64 = 0.2;
/// Cloth that is limp for its stretch keeps less, `B / (k l²)` with this l [m]: silk drapes as published,
/// not as stiffly as its mesh.
const BUCKLES: f64 = 2e-4;

/// What the simulator makes of a fabric.
pub(crate) fn material(fabric: &Fabric) -> Material {
    let limp = (fabric.bend_warp + fabric.bend_weft) / (fabric.stretch_warp + fabric.stretch_weft);
    Material {
        density: fabric.density,
        stretch: Stretch {
            warp: fabric.stretch_warp,
            weft: fabric.stretch_weft,
            shear: fabric.shear,
            compression: COMPRESSION.min(limp / (BUCKLES * BUCKLES)),
        },
        bend: Bend {
            warp: fabric.bend_warp,
            weft: fabric.bend_weft,
        },
        limit: fabric.strain_limit,
        friction: fabric.friction,
        thickness: fabric.thickness,
    }
}

fn finish(outfit: &Outfit, cloth: &Cloth, settled: Settled) -> Dressed {
    let mut drape = Drape {
        parts: outfit.parts(),
        faces: cloth.faces.clone(),
        ..Drape::default()
    };
    let all = stretch(&cloth.faces, &cloth.rest, &settled.verts);
    let per_part = drape.parts.iter().zip(&outfit.pieces).map(|(part, piece)| {
        (
            percentile_99(all[part.faces.clone()].to_vec()),
            piece.fabric.strain_limit,
        )
    });
    let quality = Quality {
        stretch: per_part.collect(),
        settled: settled.clone(),
    };
    drape.frames.push(settled.verts);
    let uv = outfit.uv(&cloth.rest);
    Dressed {
        drape,
        uv,
        quality,
        taught: false,
    }
}

/// The value that 99 % stay below; zero of none.
pub(crate) fn percentile_99(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let at = (values.len().saturating_sub(1) as f64 * 0.99).round() as usize;
    values.get(at).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quality(body: usize, cloth: usize) -> Quality {
        let settled = Settled {
            body_intersections: body,
            self_crossings: cloth,
            ..Settled::default()
        };
        Quality {
            settled,
            stretch: vec![(0.05, Some(0.06)), (0.5, None)],
        }
    }

    #[test]
    fn crossings_stop_delivery_unless_allowed_but_cloth_in_the_body_always_does() {
        assert!(quality(0, 0).fault(false).is_none());
        assert_eq!(
            quality(0, 2).fault(false).map(|f| f.exit),
            Some(Exit::Quality)
        );
        assert!(quality(0, 2).fault(true).is_none());
        assert_eq!(
            quality(1, 0).fault(true).map(|f| f.code),
            Some("cloth-in-body")
        );
    }

    #[test]
    fn a_fabric_without_a_limit_is_never_beyond_it() {
        assert!(quality(0, 0).within_limits());
        let beyond = Quality {
            stretch: vec![(0.08, Some(0.06))],
            ..quality(0, 0)
        };
        assert!(!beyond.within_limits());
    }
}
