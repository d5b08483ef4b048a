//! Operators: what each code means and which options it carries.

use muslin_net::{Activation, Graph, Kind, Node, Padding, Window};

use super::flat::Table;
use super::weights::Store;
use super::{TfliteError, indices};

type Read<T> = Result<T, TfliteError>;

/// Operator codes and the type of their options, from the TensorFlow Lite schema, version 3.
mod code {
    pub const ADD: i32 = 0;
    pub const CONCATENATION: i32 = 2;
    pub const CONV_2D: i32 = 3;
    pub const DEPTHWISE_CONV_2D: i32 = 4;
    pub const DEPTH_TO_SPACE: i32 = 5;
    pub const DEQUANTIZE: i32 = 6;
    pub const FULLY_CONNECTED: i32 = 9;
    pub const LOGISTIC: i32 = 14;
    pub const MAX_POOL_2D: i32 = 17;
    pub const RESHAPE: i32 = 22;
    pub const RESIZE_BILINEAR: i32 = 23;
    pub const PAD: i32 = 34;
    pub const PRELU: i32 = 54;
    pub const DENSIFY: i32 = 124;
}

/// An operator and its options.
struct Operator<'a> {
    table: Table<'a>,
    code: i32,
    options: Option<Table<'a>>,
    inputs: Vec<usize>,
    output: usize,
}

/// Appends the node that `table` describes, or folds it into the constants.
pub(super) fn read(
    table: Table<'_>,
    codes: &[i32],
    store: &mut Store<'_>,
    graph: &mut Graph,
) -> Read<()> {
    let op = operator(table, codes, store.len())?;
    if matches!(op.code, code::DEQUANTIZE | code::DENSIFY) {
        let [from] = op.inputs[..] else {
            return Err(op.wrong("not one argument"));
        };
        return store.widen(from, op.output);
    }
    let kind = kind(&op, store, graph)?;
    let arity = if settings(op.code) {
        1
    } else {
        op.inputs.len()
    };
    let inputs = op.inputs[..arity].to_vec();
    for &t in &inputs {
        if graph.tensors[t].data.is_none() {
            graph.tensors[t].data = store.floats(t)?;
        }
    }
    graph.nodes.push(Node {
        kind,
        inputs,
        output: op.output,
    });
    Ok(())
}

/// Whether arguments after the first are settings, not values.
fn settings(code: i32) -> bool {
    matches!(code, code::PAD | code::RESHAPE | code::RESIZE_BILINEAR)
}

fn operator<'a>(table: Table<'a>, codes: &[i32], n_tensors: usize) -> Read<Operator<'a>> {
    let index = table.u32(0, 0)? as usize;
    let wrong = |what: String| TfliteError::new(table.at(), what);
    let code = *codes
        .get(index)
        .ok_or_else(|| wrong(format!("operator code {index}")))?;
    let [output] = indices(table, 2, n_tensors)?[..] else {
        return Err(wrong("not exactly one output".into()));
    };
    let inputs = indices(table, 1, n_tensors)?;
    if inputs.is_empty() {
        return Err(wrong("no arguments".into()));
    }
    let options = table.table(4)?;
    let kind = table.u8(3, 0)?;
    if options.is_some() && options_of(code).is_some_and(|want| want != kind) {
        return Err(wrong(format!("options of type {kind} for operator {code}")));
    }
    Ok(Operator {
        table,
        code,
        options,
        inputs,
        output,
    })
}

/// The type of options an operator carries, where they are read.
fn options_of(code: i32) -> Option<u8> {
    match code {
        code::CONV_2D => Some(1),
        code::DEPTHWISE_CONV_2D => Some(2),
        code::MAX_POOL_2D => Some(5),
        code::FULLY_CONNECTED => Some(8),
        code::CONCATENATION => Some(10),
        code::ADD => Some(11),
        code::RESIZE_BILINEAR => Some(15),
        code::DEPTH_TO_SPACE => Some(94),
        _ => None,
    }
}

fn kind(op: &Operator<'_>, store: &Store<'_>, graph: &Graph) -> Read<Kind> {
    match op.code {
        code::CONV_2D => {
            op.undilated(4)?;
            Ok(Kind::Conv(op.window()?, op.activation(3)?))
        }
        code::DEPTHWISE_CONV_2D => {
            op.undilated(5)?;
            Ok(Kind::Depthwise(op.window()?, op.activation(4)?))
        }
        code::FULLY_CONNECTED => Ok(Kind::FullyConnected(op.activation(0)?)),
        code::ADD => Ok(Kind::Add(op.activation(0)?)),
        code::PAD => zeros(op, store),
        code::MAX_POOL_2D => {
            op.inactive(5)?;
            Ok(Kind::MaxPool {
                window: op.window()?,
                size: [op.count(4)?, op.count(3)?],
            })
        }
        code::RESIZE_BILINEAR => resize(op, store),
        code::DEPTH_TO_SPACE => Ok(Kind::DepthToSpace(op.count(0)?)),
        code::RESHAPE => Ok(Kind::Reshape(graph.tensors[op.output].shape.clone())),
        code::CONCATENATION => concat(op, graph),
        code::LOGISTIC => Ok(Kind::Logistic),
        code::PRELU => Ok(Kind::Prelu),
        other => Err(op.wrong(format!("operator {other} is not one of those read here"))),
    }
}

fn zeros(op: &Operator<'_>, store: &Store<'_>) -> Read<Kind> {
    let [_, around] = op.inputs[..] else {
        return Err(op.wrong("padding without amounts"));
    };
    let around = store.integers(around)?;
    let count = |n: i32| usize::try_from(n).map_err(|_| op.wrong(format!("a padding of {n}")));
    let pairs = around
        .chunks_exact(2)
        .map(|p| Ok([count(p[0])?, count(p[1])?]));
    Ok(Kind::Pad(pairs.collect::<Read<_>>()?))
}

fn resize(op: &Operator<'_>, store: &Store<'_>) -> Read<Kind> {
    let [_, size] = op.inputs[..] else {
        return Err(op.wrong("scaling without a size"));
    };
    let size: Vec<usize> = store
        .integers(size)?
        .iter()
        .filter_map(|&n| usize::try_from(n).ok())
        .collect();
    let [h, w] = size[..] else {
        return Err(op.wrong("scaling to no two sizes"));
    };
    Ok(Kind::Resize {
        size: [h, w],
        align_corners: op.option_u8(2)? != 0,
        half_pixel: op.option_u8(3)? != 0,
    })
}

fn concat(op: &Operator<'_>, graph: &Graph) -> Read<Kind> {
    op.inactive(1)?;
    let axis = op.option_i32(0, 0)?;
    let rank = graph.tensors[op.output].shape.len() as i32;
    let from_front = if axis < 0 {
        axis.saturating_add(rank)
    } else {
        axis
    };
    let axis = usize::try_from(from_front).map_err(|_| op.wrong(format!("axis {axis}")))?;
    Ok(Kind::Concat(axis))
}

impl Operator<'_> {
    fn wrong(&self, what: impl Into<String>) -> TfliteError {
        TfliteError::new(self.table.at(), what)
    }

    fn option_u8(&self, field: usize) -> Read<u8> {
        self.options.map_or(Ok(0), |o| o.u8(field, 0))
    }

    fn option_i32(&self, field: usize, default: i32) -> Read<i32> {
        self.options.map_or(Ok(default), |o| o.i32(field, default))
    }

    fn count(&self, field: usize) -> Read<usize> {
        let n = self.option_i32(field, 0)?;
        usize::try_from(n).map_err(|_| self.wrong(format!("option {field} is {n}")))
    }

    /// Padding, horizontal and vertical stride: the first three options of every window.
    fn window(&self) -> Read<Window> {
        let padding = match self.option_u8(0)? {
            0 => Padding::Same,
            1 => Padding::Valid,
            p => return Err(self.wrong(format!("padding {p}"))),
        };
        Ok(Window {
            stride: [self.count(2)?, self.count(1)?],
            padding,
        })
    }

    fn activation(&self, field: usize) -> Read<Activation> {
        match self.option_u8(field)? {
            0 => Ok(Activation::None),
            1 => Ok(Activation::Relu),
            3 => Ok(Activation::Relu6),
            a => Err(self.wrong(format!("activation {a}"))),
        }
    }

    fn inactive(&self, field: usize) -> Read<()> {
        match self.activation(field)? {
            Activation::None => Ok(()),
            a => Err(self.wrong(format!("activation {a:?} where none is read"))),
        }
    }

    /// Dilations in two fields from `field` must be one.
    fn undilated(&self, field: usize) -> Read<()> {
        let dilation = [self.option_i32(field, 1)?, self.option_i32(field + 1, 1)?];
        if dilation == [1, 1] {
            Ok(())
        } else {
            Err(self.wrong(format!("dilation {dilation:?}")))
        }
    }
}
