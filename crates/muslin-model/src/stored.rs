//! Models as named arrays, and back.

use half::f16;
use muslin_net::learn::{Mlp, Nonlinear};
use muslin_net::{Array, Numbers, Weights};

use crate::{Model, ModelError, Reader, Skin};

/// What the notes say of the kind of file.
const FORMAT: &str = "muslin-garment 1";

impl Model {
    /// As arrays; learnt shapes and the network as 16-bit floats, everything else as it is.
    pub fn to_weights(&self) -> Weights {
        let mut out = Weights {
            notes: self.notes.clone(),
            ..Weights::default()
        };
        let note =
            |out: &mut Weights, name: &str, value: String| out.notes.insert(name.into(), value);
        note(&mut out, "format", FORMAT.into());
        note(&mut out, "bones", self.bones.join(" "));
        note(&mut out, "drivers", self.drivers.join(" "));
        note(&mut out, "bend", self.encoder.bend.name().into());
        note(&mut out, "bias", self.encoder.bias.to_string());
        let mut add = |name: &str, shape: &[usize], numbers| {
            out.arrays.insert(name.into(), Array::new(shape, numbers));
        };
        let (n, m) = (self.n_verts(), self.skin.weights.len());
        let widths: Vec<u32> = self.encoder.widths.iter().map(|w| *w as u32).collect();
        let halves = |x: &[f32]| x.iter().map(|x| f16::from_f32(*x).to_bits()).collect();
        add(
            "faces",
            &[self.faces.len(), 3],
            Numbers::U32(self.faces.as_flattened().to_vec()),
        );
        add(
            "template",
            &[n, 3],
            Numbers::F32(self.template.as_flattened().to_vec()),
        );
        add(
            "skin.starts",
            &[n + 1],
            Numbers::U32(self.skin.starts.clone()),
        );
        add("skin.bones", &[m], Numbers::U8(self.skin.bones.clone()));
        add(
            "skin.weights",
            &[m],
            Numbers::F32(self.skin.weights.clone()),
        );
        add(
            "scale",
            &[self.scale.len(), 2],
            Numbers::F32(self.scale.as_flattened().to_vec()),
        );
        add("encoder.widths", &[widths.len()], Numbers::U32(widths));
        add(
            "encoder.params",
            &[self.params.len()],
            Numbers::F16(halves(&self.params)),
        );
        add(
            "modes",
            &[3 * n, self.n_codes()],
            Numbers::F16(halves(&self.modes)),
        );
        out
    }

    /// From arrays, if they are whole and fit each other.
    pub fn from_weights(weights: &Weights) -> Result<Self, ModelError> {
        let from = From { weights };
        if from.note("format")? != FORMAT {
            let what = format!("is not {FORMAT:?}; it may be of a newer version");
            return Err(ModelError::wrong("format", what));
        }
        let bend = Nonlinear::named(from.note("bend")?);
        let widths = from.u32s("encoder.widths")?.iter().map(|w| *w as usize);
        let model = Self {
            notes: weights.notes.clone(),
            faces: triples(from.u32s("faces")?),
            template: triples(&from.f32s("template")?),
            bones: names(from.note("bones")?),
            skin: Skin {
                starts: from.u32s("skin.starts")?.to_vec(),
                bones: from.bytes("skin.bones")?.to_vec(),
                weights: from.f32s("skin.weights")?,
            },
            drivers: names(from.note("drivers")?),
            scale: from.f32s("scale")?.as_chunks::<2>().0.to_vec(),
            encoder: Mlp {
                widths: widths.collect(),
                bend: bend.ok_or_else(|| ModelError::wrong("bend", "is of an unknown kind"))?,
                bias: from.note("bias")? == "true",
            },
            params: from.f32s("encoder.params")?,
            modes: from.f32s("modes")?,
        };
        model.check()?;
        Ok(model)
    }

    /// Whether all arrays fit each other.
    pub fn check(&self) -> Result<(), ModelError> {
        let fits = |name: &str, is: bool| match is {
            true => Ok(()),
            false => Err(ModelError::wrong(name, "does not fit the other arrays")),
        };
        let (n, m) = (self.n_verts(), self.skin.weights.len());
        let w = &self.encoder.widths;
        let small = |x: &usize| (1..=1 << 16).contains(x);
        fits(
            "encoder.widths",
            w.len() >= 2 && w.len() <= 64 && w.iter().all(small),
        )?;
        fits(
            "faces",
            self.faces.as_flattened().iter().all(|i| (*i as usize) < n),
        )?;
        fits(
            "skin.starts",
            self.skin.starts.len() == n + 1 && self.skin.starts.is_sorted(),
        )?;
        fits(
            "skin.starts",
            self.skin.starts[0] == 0 && self.skin.starts[n] as usize == m,
        )?;
        fits("skin.bones", self.skin.bones.len() == m)?;
        let bone = |b: &u8| usize::from(*b) < self.bones.len();
        fits("skin.bones", self.skin.bones.iter().all(bone))?;
        fits("drivers", w[0] == Reader::n_inputs_of(self.drivers.len()))?;
        fits("scale", self.scale.len() == w[0])?;
        fits(
            "encoder.params",
            self.params.len() == self.encoder.n_params(),
        )?;
        fits("modes", self.modes.len() == 3 * n * self.n_codes())?;
        let all = [&self.params, &self.modes, &self.skin.weights];
        let sound = all.iter().all(|a| a.iter().all(|x| x.is_finite()));
        let placed = self.template.as_flattened().iter().all(|x| x.is_finite());
        match sound && placed {
            true => Ok(()),
            false => Err(ModelError::wrong("weights", "are not all finite")),
        }
    }
}

struct From<'a> {
    weights: &'a Weights,
}

impl<'a> From<'a> {
    fn note(&self, name: &str) -> Result<&'a str, ModelError> {
        let found = self.weights.notes.get(name);
        found
            .map(String::as_str)
            .ok_or_else(|| ModelError::Missing(name.into()))
    }

    fn numbers(&self, name: &str) -> Result<&'a Numbers, ModelError> {
        let found = self.weights.arrays.get(name);
        found
            .map(|a| &a.numbers)
            .ok_or_else(|| ModelError::Missing(name.into()))
    }

    fn f32s(&self, name: &str) -> Result<Vec<f32>, ModelError> {
        match self.numbers(name)? {
            Numbers::F32(v) => Ok(v.clone()),
            Numbers::F16(v) => Ok(v.iter().map(|b| f16::from_bits(*b).to_f32()).collect()),
            _ => Err(ModelError::wrong(name, "holds no floats")),
        }
    }

    fn u32s(&self, name: &str) -> Result<&'a [u32], ModelError> {
        match self.numbers(name)? {
            Numbers::U32(v) => Ok(v),
            _ => Err(ModelError::wrong(name, "holds no counts")),
        }
    }

    fn bytes(&self, name: &str) -> Result<&'a [u8], ModelError> {
        match self.numbers(name)? {
            Numbers::U8(v) => Ok(v),
            _ => Err(ModelError::wrong(name, "holds no bytes")),
        }
    }
}

fn triples<T: Copy>(flat: &[T]) -> Vec<[T; 3]> {
    flat.as_chunks::<3>().0.to_vec()
}

fn names(joined: &str) -> Vec<String> {
    joined.split_whitespace().map(str::to_owned).collect()
}
