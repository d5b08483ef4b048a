//! A network as data: what a file says, before anything is folded or packed.

/// Tensors and the operations between them, in an order in which they can run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    /// Every value the graph names.
    pub tensors: Vec<Tensor>,
    /// Operations; an input is a constant, a graph input or an earlier output.
    pub nodes: Vec<Node>,
    /// Tensors the caller fills.
    pub inputs: Vec<usize>,
    /// Tensors the caller may ask for.
    pub outputs: Vec<usize>,
}

/// One value: a constant, or something computed at run time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tensor {
    /// The file's name for it; may be empty.
    pub name: String,
    /// Size of every axis, slowest first; images are `[1, height, width, channels]`.
    pub shape: Vec<usize>,
    /// The values of a constant, last axis fastest.
    pub data: Option<Vec<f32>>,
}

impl Tensor {
    /// Number of values; one for a scalar.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether some axis has no extent.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One operation.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// What it does.
    pub kind: Kind,
    /// Its arguments, as indices of tensors, in the order the kind names.
    pub inputs: Vec<usize>,
    /// The tensor it makes.
    pub output: usize,
}

/// What an operation does.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// Image, weights `[out, kh, kw, in]`, bias `[out]`.
    Conv(Window, Activation),
    /// Image, weights `[1, kh, kw, channels]`, bias `[channels]`; every channel by itself.
    Depthwise(Window, Activation),
    /// Rows `[n, in]`, weights `[out, in]`, bias `[out]`.
    FullyConnected(Activation),
    /// Two tensors of one shape.
    Add(Activation),
    /// Zeros around every axis: how many before and after.
    Pad(Vec<[usize; 2]>),
    /// The largest value of every window of `size` rows and columns.
    MaxPool {
        /// Stride and padding; padding never wins.
        window: Window,
        /// Rows and columns of the window.
        size: [usize; 2],
    },
    /// An image scaled to the output's size.
    Resize {
        /// Rows and columns wanted.
        size: [usize; 2],
        /// Corners map to corners.
        align_corners: bool,
        /// Pixels have their value at their centre, not at their corner.
        half_pixel: bool,
    },
    /// Every `block × block` channels become that many pixels.
    DepthToSpace(usize),
    /// The same values under another shape.
    Reshape(Vec<usize>),
    /// Tensors joined along an axis.
    Concat(usize),
    /// `1 / (1 + e^-x)`.
    Logistic,
    /// Negative values scaled per channel: image, slopes `[channels]`.
    Prelu,
}

/// How a window walks over an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Steps down and right, at least one.
    pub stride: [usize; 2],
    /// What happens at the edge.
    pub padding: Padding,
}

/// What a window sees beyond the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Padding {
    /// Nothing: windows lie inside.
    Valid,
    /// Enough zeros for `ceil(size / stride)` windows, the odd one after.
    Same,
}

/// What happens to a sum before it is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    #[default]
    None,
    /// Negative values become zero.
    Relu,
    /// Values are held between zero and six.
    Relu6,
}

impl Activation {
    /// The least and greatest value that passes unchanged.
    pub fn limits(self) -> [f32; 2] {
        match self {
            Self::None => [f32::NEG_INFINITY, f32::INFINITY],
            Self::Relu => [0.0, f32::INFINITY],
            Self::Relu6 => [0.0, 6.0],
        }
    }
}
