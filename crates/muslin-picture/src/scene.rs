//! What stands before the camera: parts, their cloth, the floor and the backdrop.

use glam::{DVec2, DVec3};

use crate::project::Flat;

/// Everything a picture shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// Meshes; where two are equally near, the earlier one is seen.
    pub parts: Vec<Part>,
    /// The floor, if there is one.
    pub ground: Option<Ground>,
    /// What is seen where nothing stands.
    pub background: Background,
}

impl Scene {
    /// All vertices that are drawn [m], as a camera needs them for framing.
    pub fn points(&self) -> Vec<DVec3> {
        Flat::new(self).verts
    }
}

/// A mesh of one material.
///
/// Triangles that name a missing or non-finite vertex are left out; so are
/// those without area.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Part {
    /// Positions [m].
    pub verts: Vec<DVec3>,
    /// Corner indices, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Unit normals per vertex; computed from the faces if absent or of another length.
    pub normals: Option<Vec<DVec3>>,
    /// Material coordinates per face corner [m]: x along the weft, y along the warp.
    pub uvs: Option<Vec<[DVec2; 3]>>,
    /// Linear RGB per vertex, multiplied with the material's colour.
    pub colours: Option<Vec<[f32; 3]>>,
    /// A second, painted-on layer such as a mannequin's base layer.
    pub layer: Option<Layer>,
    /// How the surface looks.
    pub material: Material,
}

impl Part {
    /// A plain mesh of one material.
    pub fn new(verts: Vec<DVec3>, faces: Vec<[u32; 3]>, material: Material) -> Self {
        Self {
            verts,
            faces,
            material,
            ..Self::default()
        }
    }
}

/// A region painted on a part, with an edge sharper than the mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Signed distance from the region's edge per vertex [m], positive inside.
    pub field: Vec<f64>,
    /// Linear RGB of the region.
    pub colour: [f32; 3],
}

/// How a surface looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Diffuse linear RGB.
    pub colour: [f32; 3],
    /// Roughness of the highlight, 0.1 (satin) to 1 (felt).
    pub roughness: f32,
    /// Reflectance of the highlight at normal incidence; 0.04 is glossless fibre.
    pub specular: f32,
    /// Linear RGB of the fuzz seen at grazing angles; black for none.
    pub sheen: [f32; 3],
    /// How far light wraps beyond the terminator, 0 to 1.
    pub wrap: f32,
    /// The weave; needs `uvs`.
    pub weave: Option<Weave>,
    /// Width of the stitched hem along open edges [m]; 0 for none.
    pub hem: f32,
    /// Seen from both sides; otherwise faces turned away are not drawn.
    pub two_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        Self::mannequin()
    }
}

impl Material {
    /// A neutral, matte, warm grey shop mannequin.
    pub fn mannequin() -> Self {
        Self {
            colour: [0.44, 0.408, 0.378],
            roughness: 0.75,
            specular: 0.025,
            sheen: [0.0; 3],
            wrap: 0.15,
            weave: None,
            hem: 0.0,
            two_sided: false,
        }
    }

    /// Soft two-sided cloth of one linear RGB colour.
    pub fn cloth(colour: [f32; 3], weave: Weave) -> Self {
        let fuzz = colour.map(|c| 0.05 + 0.25 * c);
        Self {
            colour,
            roughness: 0.8,
            specular: 0.03,
            sheen: fuzz,
            wrap: 0.2,
            weave: Some(weave),
            hem: 0.02,
            two_sided: true,
        }
    }
}

/// A repeating cloth structure, faded out where a pixel spans whole repeats.
#[derive(Clone, Debug, PartialEq)]
pub struct Weave {
    /// Which structure.
    pub kind: WeaveKind,
    /// Length of one repeat [m], positive.
    pub repeat: f32,
    /// Depth of the structure's light and dark, 0 to 1.
    pub contrast: f32,
    /// Unevenness of the yarn over millimetres to centimetres, 0 to 1.
    pub slub: f32,
}

impl Weave {
    /// A structure with its usual repeat and contrast.
    pub fn usual(kind: WeaveKind) -> Self {
        let (repeat, contrast, slub) = match kind {
            WeaveKind::Plain => (0.0008, 0.25, 0.10),
            WeaveKind::Twill => (0.0016, 0.45, 0.30),
            WeaveKind::Jersey => (0.0011, 0.35, 0.12),
            WeaveKind::Satin => (0.0006, 0.10, 0.03),
        };
        Self {
            kind,
            repeat,
            contrast,
            slub,
        }
    }
}

/// The cloth structures a picture can tell apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeaveKind {
    /// One over, one under: shirting.
    Plain,
    /// Diagonal ribs: denim, gabardine.
    Twill,
    /// Columns of small Vs: T-shirts.
    Jersey,
    /// Long floats, nearly smooth: silk, lining.
    Satin,
}

/// A floor that is only seen where shadow falls on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ground {
    /// Its height [m].
    pub height: f64,
    /// How dark the shadow gets, 0 to 1.
    pub strength: f32,
}

impl Ground {
    /// A floor at `height` [m] with the usual shadow.
    pub fn at(height: f64) -> Self {
        Self {
            height,
            strength: 0.75,
        }
    }
}

/// What is seen where nothing stands, in linear RGB as displayed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// Nothing: alpha is the figure's coverage, and the floor's shadow is translucent black.
    Transparent,
    /// One colour.
    Plain([f32; 3]),
    /// A soft pool of light behind the figure.
    Gradient {
        /// Colour at the middle.
        centre: [f32; 3],
        /// Colour at the corners.
        edge: [f32; 3],
    },
}

impl Default for Background {
    /// A light, barely warm studio grey.
    fn default() -> Self {
        Self::Gradient {
            centre: [0.90, 0.89, 0.875],
            edge: [0.70, 0.69, 0.675],
        }
    }
}
