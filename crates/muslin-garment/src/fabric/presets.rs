//! The table of fabrics.
//!
//! Human units here, as in data sheets; [`Row::fabric`] turns them into SI.
//!
//! What the choices lean on:
//! - stretch and strain limits: Penava et al. 2014 (woven cotton, wool, polyester, wool with lycra;
//!   its limits as C-IPC lists them); Clyde, Teran and Tamstorf 2017
//!   (orthotropic cotton, wool, silk, denim); Wang, O'Brien and Ramamoorthi 2011 (knits, denim);
//! - bending: Wang et al. 2011, read with `B = k/4`; KES figures of shirtings, 5e-6 to 1e-5 N m;
//! - thickness: Penava 2014 and Clyde 2017 at like weights;
//! - friction: between 0.25 (filament silk, polyester) and 0.5 (denim) as published presets span;
//! - weave repeats: usual thread counts; colours, sheen and roughness: taste.

use muslin_geom::colour::{bytes_of, linear};

use super::{Confidence, Fabric, Look, Weave};

struct Row {
    name: &'static str,
    /// [g/m²]
    weight: f64,
    /// [mm]
    thickness: f64,
    /// Warp, weft, shear [N/m].
    stretch: [f64; 3],
    /// Warp, weft [µN m].
    bend: [f64; 2],
    friction: f64,
    /// [%]
    limit: Option<f64>,
    /// What `muslin bench cloth --only physics` finds: [`Fabric::drape`].
    drape: Option<[f64; 2]>,
    source: &'static str,
    confidence: Confidence,
    /// sRGB as designers write it.
    colour: u32,
    weave: Weave,
    /// [mm]
    repeat: f64,
    /// Sheen, roughness.
    shine: [f32; 2],
}

pub(super) fn names() -> impl Iterator<Item = &'static str> {
    ROWS.iter().map(|r| r.name)
}

/// [`Fabric::drape`] of a preset.
pub(super) fn drape(name: &str) -> Option<[f64; 2]> {
    ROWS.iter().find(|r| r.name == name)?.drape
}

pub(super) fn all() -> impl Iterator<Item = Fabric> {
    ROWS.iter().map(Row::fabric)
}

impl Row {
    fn fabric(&self) -> Fabric {
        Fabric {
            name: self.name.to_owned(),
            density: self.weight * 1e-3,
            thickness: self.thickness * 1e-3,
            stretch_warp: self.stretch[0],
            stretch_weft: self.stretch[1],
            shear: self.stretch[2],
            bend_warp: self.bend[0] * 1e-6,
            bend_weft: self.bend[1] * 1e-6,
            friction: self.friction,
            // Through thousandths, so that 6 % is the number 0.06 and not one beside it.
            strain_limit: self.limit.map(|percent| (percent * 10.0).round() / 1000.0),
            source: self.source.to_owned(),
            confidence: self.confidence,
            look: Look {
                colour: linear(bytes_of(self.colour)),
                weave: self.weave,
                repeat: self.repeat * 1e-3,
                sheen: self.shine[0],
                roughness: self.shine[1],
            },
        }
    }
}

const VDP: &str = "Virtual Draping, table 1 (fibre moduli in a thin sheet); friction ours";
const SNUG: &str = "SNUG, Santesteban et al. 2022, and its code; friction ours";

const ROWS: [Row; 13] = [
    Row {
        name: "cotton-shirting",
        weight: 130.0,
        thickness: 0.25,
        stretch: [1500.0, 1000.0, 150.0],
        bend: [10.0, 7.0],
        friction: 0.35,
        limit: Some(6.0),
        drape: Some([60.6, 63.8]),
        source: "within Penava 2014, Clyde 2017, Wang 2011, KES (shirtings 5-10 µN m); bending by its drape: 61-64 % (BS 5058, published 60-76); limit: Penava 2014 plain cotton 6.1 %",
        confidence: Confidence::Chosen,
        colour: 0xc4d5e8,
        weave: Weave::Plain,
        repeat: 0.6,
        shine: [0.25, 0.85],
    },
    Row {
        name: "cotton-jersey",
        weight: 190.0,
        thickness: 0.5,
        stretch: [140.0, 100.0, 40.0],
        bend: [5.0, 4.0],
        friction: 0.40,
        limit: Some(13.0),
        drape: Some([31.0, 32.2]),
        source: "within Wang 2011 (interlock, rib knit); limit: Penava 2014 wool with lycra 13.4 %",
        confidence: Confidence::Chosen,
        colour: 0x2f6f73,
        weave: Weave::Knit,
        repeat: 0.8,
        shine: [0.35, 0.9],
    },
    Row {
        name: "silk-charmeuse",
        weight: 83.0,
        thickness: 0.18,
        stretch: [800.0, 1000.0, 60.0],
        bend: [1.0, 1.0],
        friction: 0.25,
        limit: Some(6.0),
        drape: Some([33.0, 35.3]),
        source: "within Clyde 2017 (silk); bending by its drape: 33-35 % (BS 5058, published 20-40); limit: the 6 % that published silk presets use",
        confidence: Confidence::Chosen,
        colour: 0xe0c39f,
        weave: Weave::Satin,
        repeat: 0.5,
        shine: [0.15, 0.35],
    },
    Row {
        name: "wool-suiting",
        weight: 240.0,
        thickness: 0.55,
        stretch: [1500.0, 1200.0, 120.0],
        bend: [8.5, 8.5],
        friction: 0.40,
        limit: Some(8.5),
        drape: Some([44.7, 47.5]),
        source: "within Penava 2014, Clyde 2017; bending by its drape: 45-48 % (BS 5058, published 40-70); limit: Penava 2014 wool 8.5 %",
        confidence: Confidence::Chosen,
        colour: 0x43464d,
        weave: Weave::Twill,
        repeat: 1.4,
        shine: [0.5, 0.9],
    },
    Row {
        name: "denim",
        weight: 400.0,
        thickness: 0.66,
        stretch: [3000.0, 2500.0, 600.0],
        bend: [60.0, 60.0],
        friction: 0.50,
        limit: Some(3.0),
        drape: Some([78.6, 81.5]),
        source: "within Clyde 2017, Wang 2011 (denim, pants); limit: the 3 % that published denim presets use",
        confidence: Confidence::Chosen,
        colour: 0x2e4468,
        weave: Weave::Twill,
        repeat: 1.6,
        shine: [0.2, 0.85],
    },
    Row {
        name: "polyester-lining",
        weight: 80.0,
        thickness: 0.12,
        stretch: [1500.0, 1500.0, 150.0],
        bend: [3.0, 3.0],
        friction: 0.25,
        limit: Some(6.0),
        drape: Some([51.3, 55.2]),
        source: "within Wang 2011 (tablecloth); thickness: Penava 2014 by weight; limit: its polyester 6.5 %",
        confidence: Confidence::Chosen,
        colour: 0x6b2737,
        weave: Weave::Plain,
        repeat: 0.4,
        shine: [0.15, 0.5],
    },
    Row {
        name: "nylon-taffeta",
        weight: 70.0,
        thickness: 0.1,
        stretch: [2000.0, 2000.0, 300.0],
        bend: [5.0, 5.0],
        friction: 0.25,
        limit: Some(5.0),
        drape: Some([69.4, 71.6]),
        source: "no measured set found: between lining and shirting, stiffer in shear; limit likewise",
        confidence: Confidence::Chosen,
        colour: 0x6b7350,
        weave: Weave::Plain,
        repeat: 0.4,
        shine: [0.1, 0.5],
    },
    Row {
        name: "flag-polyester",
        weight: 110.0,
        thickness: 0.2,
        stretch: [1200.0, 1000.0, 70.0],
        bend: [1.1, 1.0],
        friction: 0.30,
        limit: Some(4.0),
        drape: Some([30.3, 32.1]),
        source: "within Wang 2011 (tablecloth, jacket of polyester); bending by its drape: 30-32 % (BS 5058, published for flags 20-40); limit: the 4 % that published flag presets use",
        confidence: Confidence::Chosen,
        colour: 0x9c3530,
        weave: Weave::Plain,
        repeat: 0.5,
        shine: [0.15, 0.5],
    },
    Row {
        name: "nappa-leather",
        weight: 390.0,
        thickness: 0.6,
        stretch: [2600.0, 2200.0, 500.0],
        bend: [20.0, 20.0],
        friction: 0.50,
        limit: Some(2.0),
        drape: Some([54.7, 57.0]),
        source: "no measured set found: stretch and shear a little below denim's; bending by its drape: 55-57 % (BS 5058, published for leather 47-70); limit: the 2 % that published leather presets use",
        confidence: Confidence::Chosen,
        colour: 0x3a2a22,
        weave: Weave::Plain,
        repeat: 0.3,
        shine: [0.05, 0.45],
    },
    Row {
        name: "paper-vdp-cotton",
        weight: 17.04,
        thickness: 0.04,
        stretch: [280_000.0, 280_000.0, 94_300.0],
        bend: [49.0, 49.0],
        friction: 0.35,
        limit: None,
        drape: None,
        source: VDP,
        confidence: Confidence::Paper,
        colour: 0xd8d3c8,
        weave: Weave::Plain,
        repeat: 0.6,
        shine: [0.25, 0.85],
    },
    Row {
        name: "paper-vdp-silk",
        weight: 30.6,
        thickness: 0.06,
        stretch: [840_000.0, 840_000.0, 284_700.0],
        bend: [330.0, 330.0],
        friction: 0.25,
        limit: None,
        drape: None,
        source: VDP,
        confidence: Confidence::Paper,
        colour: 0xe6d7c3,
        weave: Weave::Satin,
        repeat: 0.5,
        shine: [0.15, 0.35],
    },
    Row {
        name: "paper-vdp-wool",
        weight: 12.0,
        thickness: 0.02,
        stretch: [62_000.0, 62_000.0, 21_000.0],
        bend: [2.7, 2.7],
        friction: 0.40,
        limit: None,
        drape: None,
        source: VDP,
        confidence: Confidence::Paper,
        colour: 0x8c8a86,
        weave: Weave::Twill,
        repeat: 1.4,
        shine: [0.5, 0.9],
    },
    Row {
        name: "paper-snug-cotton",
        weight: 200.0,
        thickness: 0.47,
        stretch: [32.9, 32.9, 11.1],
        bend: [9.9, 9.9],
        friction: 0.35,
        limit: None,
        drape: None,
        source: SNUG,
        confidence: Confidence::Paper,
        colour: 0xd8d3c8,
        weave: Weave::Plain,
        repeat: 0.6,
        shine: [0.25, 0.85],
    },
];
