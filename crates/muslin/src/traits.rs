//! What networks are told besides the pose: numbers of a fabric and of a wearer.

use muslin_body::Measures;
use muslin_garment::Fabric;
use muslin_model::Model;

use crate::size::CutFor;

/// A number by name.
pub(crate) type Trait = (&'static str, f64);

/// Of a fabric: natural logarithms of density [kg/m²], stiffness in the plane and in shear [N/m], and of
/// bending [N m]. Of warp and weft the geometric mean.
pub(crate) fn of_fabric(f: &Fabric) -> [Trait; 4] {
    [
        ("ln_density", f.density.ln()),
        ("ln_stretch", 0.5 * (f.stretch_warp * f.stretch_weft).ln()),
        ("ln_shear", f.shear.ln()),
        ("ln_bend", 0.5 * (f.bend_warp * f.bend_weft).ln()),
    ]
}

/// Of a wearer: measures at rest [m].
pub(crate) fn of_wearer(m: &Measures) -> [Trait; 7] {
    [
        ("height", m.height),
        ("chest", m.chest),
        ("waist", m.waist),
        ("hip", m.hip),
        ("inseam", m.inseam),
        ("arm", m.arm),
        ("shoulders", m.shoulders),
    ]
}

/// Of a cut: how much wider than the wearer it is made [m]; nothing where it is made to measure.
pub(crate) fn of_cut(cut: Option<&CutFor>) -> [Trait; 3] {
    let [chest, waist, hip] = cut.map_or([0.0; 3], CutFor::wider);
    [("cut_chest", chest), ("cut_waist", waist), ("cut_hip", hip)]
}

/// The model for a fabric, a wearer and a cut, as far as it is told of them.
pub(crate) fn told(
    model: Model,
    (fabric, wearer, cut): (&Fabric, &Measures, Option<&CutFor>),
) -> Model {
    let all = [&of_fabric(fabric)[..], &of_wearer(wearer), &of_cut(cut)].concat();
    told_all(model, &all)
}

/// The model for what these traits say, as far as it is told of them.
pub(crate) fn told_all(model: Model, all: &[Trait]) -> Model {
    model.told(|name| Some(all.iter().find(|t| t.0 == name)?.1))
}

/// How far beyond what was taught a trait may lie, as a share of the range: of what is drawn at random
/// nothing is quite at an end.
const BESIDE: f64 = 0.1;

/// Whether every one of the `traits` was taught, from less to more.
pub(crate) fn taught(model: &Model, traits: &[Trait]) -> bool {
    traits.iter().all(|(name, x)| {
        let known = model.traits.iter().find(|t| t.name == *name);
        known.is_some_and(|t| {
            let [least, most] = t.range.map(f64::from);
            let beside = BESIDE * (most - least);
            (least - beside..=most + beside).contains(x)
        })
    })
}
