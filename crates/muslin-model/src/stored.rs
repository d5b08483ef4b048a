//! Models as named arrays, and back.

use std::collections::BTreeMap;

use half::f16;
use muslin_net::learn::{Mlp, Nonlinear};
use muslin_net::{Array, Numbers, Weights};

use crate::packed::{Packed, Steps, stepped, unstepped};
use crate::{Encoder, FOLLOWED, Model, ModelError, Ncs, Resizer, Skin, Snug, Sway, Trait, Wall};

/// What the notes say of the kind of file: with a network of our own, with one that a note names, with a
/// network of our own that is told traits, with one of our own whose shapes are 12-bit steps, with one that a
/// note names and a resizer, and with one of our own whose shapes are 8-bit steps.
const FORMATS: [&str; 6] = [
    "muslin-garment 1",
    "muslin-garment 2",
    "muslin-garment 3",
    "muslin-garment 4",
    "muslin-garment 5",
    "muslin-garment 6",
];

/// In what numbers learnt shapes and the network are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32-bit floats: as they were learnt.
    Single,
    /// 16-bit floats.
    Half,
    /// The network in 16-bit floats, shapes in 12-bit steps, of a size of its own for every code and for every row; of a
    /// network of our own alone.
    Twelve,
    /// The same in 8-bit steps.
    Eight,
}

/// The steps of a kind of file whose shapes are counted in some.
fn steps_of(format: &str) -> Option<Steps> {
    match format {
        f if f == FORMATS[3] => Some(Steps::Twelve),
        f if f == FORMATS[5] => Some(Steps::Eight),
        _ => None,
    }
}

/// Whether a note names the network of a file of this kind.
fn names_network(format: &str) -> bool {
    [FORMATS[1], FORMATS[4]].contains(&format)
}

/// As 16-bit floats.
fn halves(x: &[f32]) -> Numbers {
    Numbers::F16(x.iter().map(|x| f16::from_f32(*x).to_bits()).collect())
}

/// A byte names no more bones.
const MOST_BONES: usize = 256;

impl Model {
    /// As arrays; learnt shapes and the network as 16-bit floats, everything else as it is.
    pub fn to_weights(&self) -> Weights {
        let mut out = Weights {
            notes: self.kept_notes(),
            ..Weights::default()
        };
        let mut add = |name: &str, shape: &[usize], numbers| {
            out.arrays.insert(name.into(), Array::new(shape, numbers));
        };
        self.add_cloth(&mut add);
        self.add_network(&mut add);
        if let Some(s) = &self.sway {
            let (n, k, m) = (self.n_verts(), s.len(), s.samples.len());
            let list = |x: &[f32]| Numbers::F32(x.to_vec());
            let (steps, bytes) = stepped(&s.shapes, k);
            add("sway.shapes", &[3 * n, k], Numbers::U8(bytes));
            add("sway.steps", &[k], Numbers::F32(steps));
            add("sway.means", &[3 * m, k], halves(&s.means));
            add("sway.stiffness", &[k], list(&s.stiffness));
            add("sway.damping", &[k], list(&s.damping));
            add("sway.samples", &[m], Numbers::U32(s.samples.clone()));
            add("sway.masses", &[m], list(&s.masses));
            if !s.walls.is_empty() {
                held(&s.walls, add);
            }
        }
        out
    }

    /// Its own notes, and those that say how its arrays are to be read.
    fn kept_notes(&self) -> BTreeMap<String, String> {
        let mut out = self.notes.clone();
        let mut note = |name: &str, value: String| out.insert(name.into(), value);
        note("bones", self.bones.join(" "));
        note("drivers", self.drivers.join(" "));
        let (format, mlp) = match &self.encoder {
            Encoder::Plain(m) if self.traits.is_empty() => (FORMATS[0], Some(m)),
            Encoder::Plain(m) => (FORMATS[2], Some(m)),
            Encoder::Pbns(m) if self.resizer.is_some() => (FORMATS[4], Some(m)),
            Encoder::Pbns(m) => (FORMATS[1], Some(m)),
            Encoder::Snug(_) => (FORMATS[1], None),
            Encoder::Ncs(n) => (FORMATS[1], Some(&n.still)),
        };
        note("format", format.into());
        if let Some(r) = &self.resizer {
            note("resizer", r.net.bend.name().into());
        }
        if names_network(format) {
            note("network", self.encoder.name().into());
        }
        if !self.traits.is_empty() {
            let names: Vec<&str> = self.traits.iter().map(|t| t.name.as_str()).collect();
            note("traits", names.join(" "));
        }
        if let Some(mlp) = mlp {
            note("bend", mlp.bend.name().into());
            note("bias", mlp.bias.to_string());
        }
        out
    }

    /// Triangles, where they lie at rest and what they follow.
    fn add_cloth(&self, add: &mut impl FnMut(&str, &[usize], Numbers)) {
        let (n, m) = (self.n_verts(), self.skin.weights.len());
        let faces = self.faces.as_flattened().to_vec();
        add("faces", &[self.faces.len(), 3], Numbers::U32(faces));
        let template = self.template.as_flattened().to_vec();
        add("template", &[n, 3], Numbers::F32(template));
        let starts = self.skin.starts.clone();
        add("skin.starts", &[n + 1], Numbers::U32(starts));
        add("skin.bones", &[m], Numbers::U8(self.skin.bones.clone()));
        let weights = self.skin.weights.clone();
        add("skin.weights", &[m], Numbers::F32(weights));
    }

    /// What the network reads, the network, and the shapes that it mixes.
    fn add_network(&self, add: &mut impl FnMut(&str, &[usize], Numbers)) {
        let n = self.n_verts();
        let scale = self.scale.as_flattened().to_vec();
        add("scale", &[self.scale.len(), 2], Numbers::F32(scale));
        if !self.traits.is_empty() {
            let rows = self.traits.iter();
            let rows = rows.flat_map(|t| [t.value, t.range[0], t.range[1]]);
            let shape = [self.traits.len(), 3];
            add("traits", &shape, Numbers::F32(rows.collect()));
        }
        for (name, widths) in widths(&self.encoder) {
            let list = widths.iter().map(|w| *w as u32).collect();
            add(name, &[widths.len()], Numbers::U32(list));
        }
        match &self.encoder {
            Encoder::Snug(s) => {
                add(
                    "encoder.body",
                    &[s.body.len()],
                    Numbers::F32(s.body.clone()),
                );
            }
            Encoder::Ncs(s) => {
                let joints = s.joints.as_flattened().to_vec();
                add("encoder.joints", &[s.joints.len(), 3], Numbers::F32(joints));
            }
            Encoder::Plain(_) | Encoder::Pbns(_) => {}
        }
        add("encoder.params", &[self.params.len()], halves(&self.params));
        add("modes", &[3 * n, self.n_codes()], halves(&self.modes));
        if let Some(r) = &self.resizer {
            let widths: Vec<u32> = r.net.widths.iter().map(|w| *w as u32).collect();
            add("resizer.widths", &[widths.len()], Numbers::U32(widths));
            add("resizer.params", &[r.params.len()], halves(&r.params));
            add("resizer.modes", &[3 * n, r.n_codes()], halves(&r.modes));
        }
    }

    /// As [`to_weights`](Self::to_weights), in numbers of such precision. Shapes of a network that is not our own are
    /// never in steps, but in 16-bit floats.
    pub fn to_weights_in(&self, precision: Precision) -> Weights {
        match precision {
            Precision::Single => self.singles(),
            Precision::Half => self.to_weights(),
            Precision::Twelve => self.packed(Steps::Twelve),
            Precision::Eight => self.packed(Steps::Eight),
        }
    }

    fn singles(&self) -> Weights {
        let mut out = self.to_weights();
        let mut whole = |name: &str, numbers: &[f32]| {
            if let Some(array) = out.arrays.get_mut(name) {
                array.numbers = Numbers::F32(numbers.to_vec());
            }
        };
        whole("encoder.params", &self.params);
        whole("modes", &self.modes);
        if let Some(r) = &self.resizer {
            whole("resizer.params", &r.params);
            whole("resizer.modes", &r.modes);
        }
        if let Some(s) = &self.sway {
            whole("sway.means", &s.means);
        }
        out
    }

    fn packed(&self, fine: Steps) -> Weights {
        let mut out = self.to_weights();
        if !matches!(self.encoder, Encoder::Plain(_)) {
            return out;
        }
        let (rows, k) = (3 * self.n_verts(), self.n_codes() - 1);
        let posed: Vec<f32> = (self.modes.chunks_exact(k + 1))
            .flat_map(|row| &row[..k])
            .copied()
            .collect();
        let still = self.modes.iter().skip(k).step_by(k + 1);
        let still = still.map(|x| f16::from_f32(*x).to_bits()).collect();
        let packed = Packed::new(&posed, k, fine);
        let format = match fine {
            Steps::Twelve => FORMATS[3],
            Steps::Eight => FORMATS[5],
        };
        out.notes.insert("format".into(), format.into());
        let mut add = |name: &str, shape: &[usize], numbers| {
            out.arrays.insert(name.into(), Array::new(shape, numbers));
        };
        add(
            "modes",
            &[rows, fine.bytes_of(k)],
            Numbers::U8(packed.bytes),
        );
        add("modes.steps", &[k], Numbers::F32(packed.steps));
        add("modes.rows", &[rows], Numbers::F16(packed.rows));
        add("modes.still", &[rows], Numbers::F16(still));
        out
    }

    /// From arrays, if they are whole and fit each other.
    pub fn from_weights(weights: &Weights) -> Result<Self, ModelError> {
        let from = From { weights };
        let format = from.note("format")?;
        if !FORMATS.contains(&format) {
            let what = format!(
                "is none of {}; it may be of a newer version",
                FORMATS.join(", ")
            );
            return Err(ModelError::wrong("format", what));
        }
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
            traits: match format == FORMATS[2] || weights.notes.contains_key("traits") {
                true => from.traits()?,
                false => Vec::new(),
            },
            encoder: match names_network(format) {
                true => from.encoder()?,
                false => Encoder::Plain(from.mlp("encoder.widths")?),
            },
            params: from.f32s("encoder.params")?,
            modes: match steps_of(format) {
                Some(fine) => from.modes(fine)?,
                None => from.f32s("modes")?,
            },
            sway: from.sway()?,
            resizer: match format == FORMATS[4] {
                true => Some(from.resizer()?),
                false => None,
            },
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
        let drivers = self.drivers.len();
        let traits = self.traits.len();
        // A resizer reads them in the encoder's stead.
        let told = if self.resizer.is_some() { 0 } else { traits };
        fits(
            "encoder.widths",
            drivers > 0 && self.encoder.fits(drivers, told),
        )?;
        let resized = |r: &Resizer| r.fits(n, traits);
        fits("resizer", self.resizer.as_ref().is_none_or(resized))?;
        fits(
            "scale",
            self.scale.len() == self.encoder.n_inputs(drivers) + self.encoder.n_told(told),
        )?;
        // A measure of the body that it is told is a trait of the wearer.
        let known = match &self.encoder {
            Encoder::Snug(s) => traits == 0 || (traits == s.body.len() && self.resizer.is_none()),
            _ => true,
        };
        fits("traits", known)?;
        // A vertex follows no bone twice.
        fits("skin.weights", m <= n * self.bones.len().max(1))?;
        fits("bones", self.bones.len() <= MOST_BONES)?;
        let ordered = |t: &Trait| {
            let sound = t.range.iter().all(|x| x.is_finite());
            sound && t.range[0] <= t.value && t.value <= t.range[1]
        };
        fits("traits", self.traits.iter().all(ordered))?;
        fits(
            "encoder.params",
            self.params.len() == self.encoder.n_params(),
        )?;
        fits("modes", self.modes.len() == 3 * n * self.n_codes())?;
        fits(
            "sway",
            self.sway
                .as_ref()
                .is_none_or(|s| s.fits(n, self.bones.len())),
        )?;
        let all = [&self.params, &self.modes, &self.skin.weights];
        let sound = all.iter().all(|a| a.iter().all(|x| x.is_finite()));
        let rest = [self.template.as_flattened(), self.scale.as_flattened()];
        let placed = rest.iter().all(|a| a.iter().all(|x| x.is_finite()));
        match sound && placed {
            true => Ok(()),
            false => Err(ModelError::wrong("weights", "are not all finite")),
        }
    }
}

/// The sizes of an encoder's parts, each under its array's name.
fn widths(encoder: &Encoder) -> Vec<(&'static str, &[usize])> {
    match encoder {
        Encoder::Plain(m) | Encoder::Pbns(m) => vec![("encoder.widths", &m.widths)],
        Encoder::Snug(s) => vec![("encoder.widths", &s.widths)],
        Encoder::Ncs(n) => vec![
            ("encoder.widths", &n.still.widths),
            ("encoder.joint", &n.joint.widths),
            ("encoder.whole", &n.whole.widths),
            ("encoder.decoder", &n.decoder.widths),
        ],
    }
}

struct From<'a> {
    weights: &'a Weights,
}

impl<'a> From<'a> {
    /// The network that a note names.
    fn encoder(&self) -> Result<Encoder, ModelError> {
        match self.note("network")? {
            "pbns" => Ok(Encoder::Pbns(self.mlp("encoder.widths")?)),
            "snug" => Ok(Encoder::Snug(Snug {
                body: self.f32s("encoder.body")?,
                widths: self.sizes("encoder.widths")?,
            })),
            "ncs" => {
                let free = |name| {
                    let mlp = self.mlp(name)?;
                    Ok(Mlp { bias: false, ..mlp })
                };
                Ok(Encoder::Ncs(Ncs {
                    joints: triples(&self.f32s("encoder.joints")?),
                    still: self.mlp("encoder.widths")?,
                    joint: free("encoder.joint")?,
                    whole: free("encoder.whole")?,
                    decoder: self.mlp("encoder.decoder")?,
                }))
            }
            other => Err(ModelError::wrong(
                "network",
                format!("is {other:?}, which this version does not know"),
            )),
        }
    }

    /// What the network is told besides the pose.
    fn traits(&self) -> Result<Vec<Trait>, ModelError> {
        let (names, rows) = (names(self.note("traits")?), self.f32s("traits")?);
        if rows.len() != 3 * names.len() {
            return Err(ModelError::wrong("traits", "are not one row a name"));
        }
        let one = |(name, row): (String, &[f32; 3])| Trait {
            name,
            value: row[0],
            range: [row[1], row[2]],
        };
        Ok(names
            .into_iter()
            .zip(rows.as_chunks::<3>().0)
            .map(one)
            .collect())
    }

    /// How the cloth swings, if the file says so.
    fn sway(&self) -> Result<Option<Sway>, ModelError> {
        let has = |name: &str| self.weights.arrays.contains_key(name);
        // Walls that knew the skin at rest alone: how the cloth swings is found anew.
        if !has("sway.shapes") || has("sway.rooms") {
            return Ok(None);
        }
        Ok(Some(Sway {
            shapes: unstepped(self.bytes("sway.shapes")?, &self.f32s("sway.steps")?),
            means: self.f32s("sway.means")?,
            stiffness: self.f32s("sway.stiffness")?,
            damping: self.f32s("sway.damping")?,
            samples: self.u32s("sway.samples")?.to_vec(),
            masses: self.f32s("sway.masses")?,
            walls: match has("sway.walls") {
                true => self.walls()?,
                false => Vec::new(),
            },
        }))
    }

    /// What holds swings back.
    fn walls(&self) -> Result<Vec<Wall>, ModelError> {
        let verts = self.u32s("sway.walls")?;
        let [feet, outs] = [self.f32s("sway.feet")?, self.f32s("sway.outs")?].map(|a| triples(&a));
        let bones = self.bytes("sway.foot_bones")?.as_chunks::<FOLLOWED>().0;
        let weights = self.f32s("sway.foot_weights")?;
        let weights = weights.as_chunks::<FOLLOWED>().0;
        let n = verts.len();
        if [feet.len(), outs.len(), bones.len(), weights.len()] != [n; 4] {
            return Err(ModelError::wrong("sway.walls", "do not fit each other"));
        }
        let one = |i: usize| Wall {
            vertex: verts[i],
            foot: feet[i],
            out: outs[i],
            bones: bones[i],
            weights: weights[i],
        };
        Ok((0..n).map(one).collect())
    }

    /// The network that lays the cloth on others.
    fn resizer(&self) -> Result<Resizer, ModelError> {
        Ok(Resizer {
            net: Mlp {
                widths: self.sizes("resizer.widths")?,
                bend: self.bend("resizer")?,
                bias: true,
            },
            params: self.f32s("resizer.params")?,
            modes: self.f32s("resizer.modes")?,
        })
    }

    /// Learnt shapes that are packed.
    fn modes(&self, fine: Steps) -> Result<Vec<f32>, ModelError> {
        let (rows, steps) = (self.f32s("modes.rows")?, self.f32s("modes.steps")?);
        let (still, bytes) = (self.f32s("modes.still")?, self.bytes("modes")?);
        let wide = fine.bytes_of(steps.len());
        for (name, len, want) in [
            ("modes.still", still.len(), rows.len()),
            ("modes", bytes.len(), rows.len() * wide),
        ] {
            if len != want {
                return Err(ModelError::wrong(name, "does not fit modes.rows"));
            }
        }
        let mut out = Vec::with_capacity(rows.len() * (steps.len() + 1));
        for (v, (row, still)) in rows.iter().zip(still).enumerate() {
            let counts = fine.read(&bytes[v * wide..(v + 1) * wide]);
            out.extend(steps.iter().zip(counts).map(|(s, count)| count * s * row));
            out.push(still);
        }
        Ok(out)
    }

    /// A perceptron of these widths.
    fn mlp(&self, widths: &str) -> Result<Mlp, ModelError> {
        Ok(Mlp {
            widths: self.sizes(widths)?,
            bend: self.bend("bend")?,
            bias: self.note("bias")? == "true",
        })
    }

    /// The function that a note names.
    fn bend(&self, note: &str) -> Result<Nonlinear, ModelError> {
        let bend = Nonlinear::named(self.note(note)?);
        bend.ok_or_else(|| ModelError::wrong(note, "is of an unknown kind"))
    }

    fn sizes(&self, name: &str) -> Result<Vec<usize>, ModelError> {
        Ok(self.u32s(name)?.iter().map(|w| *w as usize).collect())
    }

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

/// Adds what holds swings back.
fn held(walls: &[Wall], mut add: impl FnMut(&str, &[usize], Numbers)) {
    let n = walls.len();
    let verts = walls.iter().map(|w| w.vertex).collect();
    let each = |one: fn(&Wall) -> [f32; 3]| walls.iter().flat_map(one).collect();
    let bones = walls.iter().flat_map(|w| w.bones).collect();
    let weights = walls.iter().flat_map(|w| w.weights).collect();
    add("sway.walls", &[n], Numbers::U32(verts));
    add("sway.feet", &[n, 3], Numbers::F32(each(|w| w.foot)));
    add("sway.outs", &[n, 3], Numbers::F32(each(|w| w.out)));
    add("sway.foot_bones", &[n, FOLLOWED], Numbers::U8(bones));
    add("sway.foot_weights", &[n, FOLLOWED], Numbers::F32(weights));
}

fn triples<T: Copy>(flat: &[T]) -> Vec<[T; 3]> {
    flat.as_chunks::<3>().0.to_vec()
}

fn names(joined: &str) -> Vec<String> {
    joined.split_whitespace().map(str::to_owned).collect()
}
