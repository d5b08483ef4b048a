//! Networks from TensorFlow Lite files.
//!
//! Reads the one-subgraph float models that people trackers ship: 16-bit weights are widened and
//! sparse ones filled in while loading, so that what comes out is a plain [`Graph`]. Every offset
//! is checked before it is followed; whatever is wrong is reported with the byte where it was
//! found.

mod flat;
mod nodes;
mod weights;

use flat::Table;
use muslin_net::{Graph, Tensor};
use weights::Store;

/// Largest file taken [bytes].
const MOST_BYTES: usize = 256 << 20;
/// Most tensors, operators or operator codes.
const MOST_ITEMS: usize = 1 << 14;
/// Most axes of a tensor.
const MOST_AXES: usize = 8;
/// Longest name kept [bytes].
const LONGEST_NAME: usize = 120;

/// What is wrong with a model, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the model is damaged or of a kind not read here: at byte {at}: {what}")]
pub struct TfliteError {
    /// Offset into the file [bytes].
    pub at: usize,
    /// What was found there.
    pub what: String,
}

impl TfliteError {
    fn new(at: usize, what: impl Into<String>) -> Self {
        Self {
            at,
            what: what.into(),
        }
    }
}

/// Reads a `.tflite` model of one subgraph.
///
/// The graph's shapes are as the file states them; [`muslin_net::Net`] proves them.
pub fn read_tflite(bytes: &[u8]) -> Result<Graph, TfliteError> {
    if bytes.len() > MOST_BYTES {
        return Err(TfliteError::new(
            0,
            format!("{} bytes are too many", bytes.len()),
        ));
    }
    let model = Table::root(bytes, *b"TFL3")?;
    match model.u32(0, 0)? {
        3 => {}
        v => {
            return Err(TfliteError::new(
                model.at(),
                format!("schema version {v}, not 3"),
            ));
        }
    }
    let codes = model
        .tables(1, MOST_ITEMS)?
        .into_iter()
        .map(code)
        .collect::<Result<Vec<i32>, _>>()?;
    let [main] = model.tables(2, MOST_ITEMS)?[..] else {
        return Err(TfliteError::new(model.at(), "not exactly one subgraph"));
    };
    let buffers = model.tables(4, MOST_ITEMS)?;
    let tensors = main.tables(0, MOST_ITEMS)?;
    let mut store = Store::new(&tensors, &buffers)?;
    let mut graph = Graph {
        tensors: tensors
            .iter()
            .map(|t| tensor(*t))
            .collect::<Result<_, _>>()?,
        inputs: indices(main, 1, tensors.len())?,
        outputs: indices(main, 2, tensors.len())?,
        nodes: Vec::new(),
    };
    for operator in main.tables(3, MOST_ITEMS)? {
        nodes::read(operator, &codes, &mut store, &mut graph)?;
    }
    Ok(graph)
}

/// The built-in operator an operator code stands for.
fn code(table: Table<'_>) -> Result<i32, TfliteError> {
    // Codes beyond 127 moved to a wider field; whichever is larger is meant.
    Ok(table.i32(3, 0)?.max(i32::from(table.u8(0, 0)?)))
}

/// Name and shape.
fn tensor(table: Table<'_>) -> Result<Tensor, TfliteError> {
    let name = table.bytes(3)?.unwrap_or_default();
    let name = &name[..name.len().min(LONGEST_NAME)];
    Ok(Tensor {
        name: String::from_utf8_lossy(name).into_owned(),
        shape: shape(table)?,
        data: None,
    })
}

fn shape(table: Table<'_>) -> Result<Vec<usize>, TfliteError> {
    let axes = table.i32s(0, MOST_AXES)?;
    let axis = |&n: &i32| {
        usize::try_from(n).map_err(|_| TfliteError::new(table.at(), format!("an axis of {n}")))
    };
    axes.iter().map(axis).collect()
}

/// Indices below `n`.
fn indices(table: Table<'_>, field: usize, n: usize) -> Result<Vec<usize>, TfliteError> {
    let index = |&i: &i32| {
        usize::try_from(i)
            .ok()
            .filter(|&i| i < n)
            .ok_or_else(|| TfliteError::new(table.at(), format!("tensor {i} of {n}")))
    };
    table.i32s(field, 256)?.iter().map(index).collect()
}

#[cfg(test)]
mod tests;
