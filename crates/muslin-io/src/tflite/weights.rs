//! Constants: raw bytes, 16-bit floats widened, sparse lists filled in.

use half::f16;

use super::flat::Table;
use super::{MOST_AXES, TfliteError, shape};

/// Most values all constants may hold together.
const MOST_VALUES: usize = 1 << 25;

type Read<T> = Result<T, TfliteError>;

/// The constants of a model, made as they are asked for.
pub(super) struct Store<'a> {
    values: Vec<Value<'a>>,
    left: usize,
}

struct Value<'a> {
    table: Table<'a>,
    kind: u8,
    raw: &'a [u8],
    /// What a widening or filling node made of a constant.
    made: Option<Vec<f32>>,
}

const F32: u8 = 0;
const F16: u8 = 1;
const I32: u8 = 2;

impl<'a> Store<'a> {
    pub(super) fn new(tensors: &[Table<'a>], buffers: &[Table<'a>]) -> Read<Self> {
        let value = |table: &Table<'a>| {
            let buffer = table.u32(2, 0)? as usize;
            let holder = buffers.get(buffer).ok_or_else(|| {
                TfliteError::new(table.at(), format!("buffer {buffer} of {}", buffers.len()))
            })?;
            let raw = holder.bytes(0)?.unwrap_or_default();
            Ok(Value {
                table: *table,
                kind: table.u8(1, 0)?,
                raw,
                made: None,
            })
        };
        let values = tensors.iter().map(value).collect::<Read<_>>()?;
        Ok(Self {
            values,
            left: MOST_VALUES,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.values.len()
    }

    /// The values of tensor `t` if it is a constant of floats; `None` if it is computed.
    pub(super) fn floats(&mut self, t: usize) -> Read<Option<Vec<f32>>> {
        let value = &self.values[t];
        if let Some(made) = &value.made {
            let made = made.clone();
            self.spend(made.len(), t)?;
            return Ok(Some(made));
        }
        match (value.raw.is_empty(), value.kind) {
            (true, _) => Ok(None),
            (_, F32) if value.table.table(6)?.is_none() => self.raw(t).map(Some),
            (_, kind) => Err(self.wrong(t, format!("type {kind} where 32-bit floats belong"))),
        }
    }

    /// The values of tensor `t`, a constant of 32-bit integers.
    pub(super) fn integers(&self, t: usize) -> Read<Vec<i32>> {
        let value = &self.values[t];
        if value.kind != I32 || value.raw.len() > 4 * 64 {
            return Err(self.wrong(t, "not a short list of 32-bit integers"));
        }
        Ok(value
            .raw
            .as_chunks()
            .0
            .iter()
            .map(|b| i32::from_le_bytes(*b))
            .collect())
    }

    /// Tensor `to` is the wide or filled-in form of constant `from`.
    pub(super) fn widen(&mut self, from: usize, to: usize) -> Read<()> {
        let value = &mut self.values[from];
        let made = match value.made.take() {
            Some(made) => made,
            None if value.table.table(6)?.is_some() => self.filled(from)?,
            None => self.raw(from)?,
        };
        self.values[to].made = Some(made);
        Ok(())
    }

    /// Dense floats straight from the file.
    fn raw(&mut self, t: usize) -> Read<Vec<f32>> {
        let n = self.values[t].raw.len() / if self.values[t].kind == F16 { 2 } else { 4 };
        self.spend(n, t)?;
        let value = &self.values[t];
        match value.kind {
            F16 => Ok(value
                .raw
                .as_chunks()
                .0
                .iter()
                .map(|b| f16::from_le_bytes(*b).to_f32())
                .collect()),
            F32 => Ok(value
                .raw
                .as_chunks()
                .0
                .iter()
                .map(|b| f32::from_le_bytes(*b))
                .collect()),
            kind => Err(self.wrong(t, format!("type {kind} where floats belong"))),
        }
    }

    /// Dense floats from a list of those that are not zero.
    fn filled(&mut self, t: usize) -> Read<Vec<f32>> {
        let listed = self.raw(t)?;
        let table = self.values[t].table;
        let shape = shape(table)?;
        let n = shape.iter().try_fold(1usize, |n, &s| n.checked_mul(s));
        let n = n.ok_or_else(|| self.wrong(t, format!("shape {shape:?}")))?;
        self.spend(n, t)?;
        let sparsity = table
            .table(6)?
            .ok_or_else(|| self.wrong(t, "no list of places"))?;
        let places = places(sparsity, &shape)?;
        if places.len() != listed.len() {
            let what = format!("{} values for {} places", listed.len(), places.len());
            return Err(self.wrong(t, what));
        }
        let mut dense = vec![0.0; n];
        places
            .iter()
            .zip(listed)
            .for_each(|(&place, x)| dense[place] = x);
        Ok(dense)
    }

    fn spend(&mut self, n: usize, t: usize) -> Read<()> {
        let left = self.left.checked_sub(n);
        self.left = left.ok_or_else(|| self.wrong(t, "the constants are too large together"))?;
        Ok(())
    }

    pub(super) fn wrong(&self, t: usize, what: impl Into<String>) -> TfliteError {
        TfliteError::new(
            self.values[t].table.at(),
            format!("tensor {t}: {}", what.into()),
        )
    }
}

/// Where in the dense values each listed one belongs.
///
/// Axes are walked in the file's order; a dense axis visits every index, a compressed one those
/// it lists. After every axis the list holds the places reached so far, in order.
fn places(sparsity: Table<'_>, shape: &[usize]) -> Read<Vec<usize>> {
    let order = sparsity.i32s(0, MOST_AXES)?;
    let levels = sparsity.tables(2, MOST_AXES)?;
    let wrong = |what: String| TfliteError::new(sparsity.at(), what);
    let mut sorted = order.clone();
    sorted.sort_unstable();
    let each_once = sorted.iter().copied().eq((0..).take(shape.len()));
    if !each_once || levels.len() != shape.len() || !sparsity.i32s(1, MOST_AXES)?.is_empty() {
        return Err(wrong(format!(
            "a sparse layout of axes {order:?} for {shape:?}"
        )));
    }
    let mut places = vec![0];
    for (&axis, level) in order.iter().zip(levels) {
        let axis = axis as usize;
        let step: usize = shape[axis + 1..].iter().product();
        places = match level.u8(0, 0)? {
            0 if level.i32(1, 0)?.cast_unsigned() as usize == shape[axis] => places
                .iter()
                .flat_map(|p| (0..shape[axis]).map(move |i| p + i * step))
                .collect(),
            1 => compressed(level, &places, (shape[axis], step))?,
            format => return Err(wrong(format!("axis {axis} of format {format}"))),
        };
    }
    Ok(places)
}

/// The places after a compressed axis of `n` indices, `step` values apart.
fn compressed(level: Table<'_>, places: &[usize], (n, step): (usize, usize)) -> Read<Vec<usize>> {
    let segments = numbers(level, 2)?;
    let indices = numbers(level, 4)?;
    let rising = segments.is_sorted() && segments.first() == Some(&0);
    let whole = segments.last() == Some(&indices.len()) && segments.len() == places.len() + 1;
    if !rising || !whole || indices.iter().any(|&i| i >= n) {
        let what = format!("{} segments and {} indices", segments.len(), indices.len());
        return Err(TfliteError::new(level.at(), what));
    }
    let one = |(p, s): (&usize, &[usize])| {
        let base = *p;
        indices[s[0]..s[1]]
            .iter()
            .map(move |i| base + i * step)
            .collect::<Vec<_>>()
    };
    Ok(places
        .iter()
        .zip(segments.windows(2))
        .flat_map(one)
        .collect())
}

/// A list of numbers of one of three widths: its type in field `i`, itself in the next.
fn numbers(level: Table<'_>, i: usize) -> Read<Vec<usize>> {
    let kind = level.u8(i, 0)?;
    let list = level.table(i + 1)?;
    let list =
        list.ok_or_else(|| TfliteError::new(level.at(), "a compressed axis lists nothing"))?;
    match kind {
        1 => list
            .i32s(0, MOST_VALUES)?
            .iter()
            .map(|&x| usize::try_from(x))
            .collect::<Result<_, _>>(),
        2 => Ok(list.u16s(0)?.into_iter().map(usize::from).collect()),
        3 => Ok(list
            .bytes(0)?
            .unwrap_or_default()
            .iter()
            .map(|&x| usize::from(x))
            .collect()),
        _ => {
            return Err(TfliteError::new(
                level.at(),
                format!("a list of kind {kind}"),
            ));
        }
    }
    .map_err(|_| TfliteError::new(list.at(), "a negative place"))
}
