//! What shape an operation makes of its arguments, and whether it can take them at all.

use crate::graph::{Kind, Padding, Window};

/// The output shape of `kind` over arguments of these shapes, or what is wrong with them.
pub(crate) fn infer(kind: &Kind, args: &[&[usize]]) -> Result<Vec<usize>, String> {
    let n_args = n_args(kind).unwrap_or(args.len());
    need(args.len() == n_args && n_args > 0, || {
        format!("{} arguments", args.len())
    })?;
    match kind {
        Kind::Conv(w, _) => conv(args, *w),
        Kind::Depthwise(w, _) => depthwise(args, *w),
        Kind::FullyConnected(_) => fully_connected(args),
        Kind::Add(_) => same(args[0], args[1]),
        Kind::Pad(p) => pad(args[0], p),
        Kind::MaxPool { window, size } => pool(args[0], *window, *size),
        Kind::Resize { size, .. } => {
            let [h, w, c] = image(args[0])?;
            need(h * w * c > 0 && size[0] > 0 && size[1] > 0, || {
                "an empty image".into()
            })?;
            Ok(vec![1, size[0], size[1], c])
        }
        Kind::DepthToSpace(b) => depth_to_space(args[0], *b),
        Kind::Reshape(s) => reshape(args[0], s),
        Kind::Concat(axis) => concat(args, *axis),
        Kind::Logistic => Ok(args[0].to_vec()),
        Kind::Prelu => prelu(args),
    }
}

fn n_args(kind: &Kind) -> Option<usize> {
    match kind {
        Kind::Conv(..) | Kind::Depthwise(..) | Kind::FullyConnected(_) => Some(3),
        Kind::Add(_) | Kind::Prelu => Some(2),
        Kind::Concat(_) => None,
        _ => Some(1),
    }
}

fn need(ok: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if ok { Ok(()) } else { Err(what()) }
}

/// How many values a shape holds, unless that is beyond counting.
pub(crate) fn count(shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(1usize, |n, &s| n.checked_mul(s))
}

/// Rows, columns and channels of a batch of one.
pub(crate) fn image(shape: &[usize]) -> Result<[usize; 3], String> {
    match *shape {
        [1, h, w, c] => Ok([h, w, c]),
        _ => Err(format!(
            "{shape:?} where one image [1, height, width, channels] belongs"
        )),
    }
}

/// Output length and zeros before and after, for one axis of a window.
pub(crate) fn slide(n: usize, k: usize, stride: usize, p: Padding) -> Option<[usize; 3]> {
    if k == 0 || stride == 0 || n == 0 {
        return None;
    }
    match p {
        Padding::Valid => Some([n.checked_sub(k)? / stride + 1, 0, 0]),
        Padding::Same => {
            let out = n.div_ceil(stride);
            let total = ((out - 1) * stride + k).saturating_sub(n);
            Some([out, total / 2, total - total / 2])
        }
    }
}

fn slide_both(hw: [usize; 2], size: [usize; 2], w: Window) -> Result<[usize; 2], String> {
    let axis = |i: usize| {
        slide(hw[i], size[i], w.stride[i], w.padding)
            .map(|s| s[0])
            .ok_or_else(|| format!("a {size:?} window does not fit a {hw:?} image"))
    };
    Ok([axis(0)?, axis(1)?])
}

fn conv(args: &[&[usize]], w: Window) -> Result<Vec<usize>, String> {
    let [h, wd, c] = image(args[0])?;
    let [n, kh, kw, ci] = *args[1] else {
        return Err(format!("weights {:?}", args[1]));
    };
    need(ci == c && ci * n > 0 && args[2] == [n], || {
        format!(
            "image {:?}, weights {:?}, bias {:?}",
            args[0], args[1], args[2]
        )
    })?;
    let [oh, ow] = slide_both([h, wd], [kh, kw], w)?;
    Ok(vec![1, oh, ow, n])
}

fn depthwise(args: &[&[usize]], w: Window) -> Result<Vec<usize>, String> {
    let [h, wd, c] = image(args[0])?;
    let [1, kh, kw, ci] = *args[1] else {
        return Err(format!("weights {:?}", args[1]));
    };
    need(ci == c && c > 0 && args[2] == [c], || {
        format!(
            "image {:?}, weights {:?}, bias {:?}",
            args[0], args[1], args[2]
        )
    })?;
    let [oh, ow] = slide_both([h, wd], [kh, kw], w)?;
    Ok(vec![1, oh, ow, c])
}

fn fully_connected(args: &[&[usize]]) -> Result<Vec<usize>, String> {
    match (args[0], args[1], args[2]) {
        (&[rows, k], &[n, k2], &[n2]) if k == k2 && n == n2 && rows * k * n > 0 => {
            Ok(vec![rows, n])
        }
        _ => Err(format!(
            "rows {:?}, weights {:?}, bias {:?}",
            args[0], args[1], args[2]
        )),
    }
}

fn same(a: &[usize], b: &[usize]) -> Result<Vec<usize>, String> {
    need(a == b, || format!("{a:?} and {b:?} differ"))?;
    Ok(a.to_vec())
}

fn pad(a: &[usize], p: &[[usize; 2]]) -> Result<Vec<usize>, String> {
    image(a)?;
    need(a.len() == p.len(), || {
        format!("{} paddings for {a:?}", p.len())
    })?;
    Ok(a.iter().zip(p).map(|(n, [b, e])| n + b + e).collect())
}

fn pool(a: &[usize], w: Window, size: [usize; 2]) -> Result<Vec<usize>, String> {
    let [h, wd, c] = image(a)?;
    let [oh, ow] = slide_both([h, wd], size, w)?;
    Ok(vec![1, oh, ow, c])
}

fn depth_to_space(a: &[usize], b: usize) -> Result<Vec<usize>, String> {
    let [h, w, c] = image(a)?;
    need(b > 0 && c.is_multiple_of(b * b), || {
        format!("{c} channels into blocks of {b}")
    })?;
    Ok(vec![1, h * b, w * b, c / (b * b)])
}

fn reshape(a: &[usize], s: &[usize]) -> Result<Vec<usize>, String> {
    need(count(a).is_some_and(|n| count(s) == Some(n)), || {
        format!("{a:?} into {s:?}")
    })?;
    Ok(s.to_vec())
}

fn concat(args: &[&[usize]], axis: usize) -> Result<Vec<usize>, String> {
    let mut out = args[0].to_vec();
    need(axis < out.len(), || format!("axis {axis} of {out:?}"))?;
    for a in &args[1..] {
        let fits = a.len() == out.len() && (0..a.len()).all(|i| i == axis || a[i] == out[i]);
        need(fits, || {
            format!("{a:?} joined to {out:?} along axis {axis}")
        })?;
        out[axis] += a[axis];
    }
    Ok(out)
}

fn prelu(args: &[&[usize]]) -> Result<Vec<usize>, String> {
    let [.., c] = *args[0] else {
        return Err("a scalar".into());
    };
    need(
        c > 0 && args[1].iter().product::<usize>() == c && args[1].last() == Some(&c),
        || format!("slopes {:?} for {:?}", args[1], args[0]),
    )?;
    Ok(args[0].to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_count_as_the_formulas_say() {
        assert_eq!(slide(7, 3, 2, Padding::Valid), Some([3, 0, 0]));
        assert_eq!(slide(7, 3, 2, Padding::Same), Some([4, 1, 1]));
        assert_eq!(slide(8, 3, 2, Padding::Same), Some([4, 0, 1]));
        assert_eq!(slide(2, 3, 1, Padding::Valid), None);
        assert_eq!(slide(2, 3, 0, Padding::Same), None);
    }

    #[test]
    fn arguments_that_do_not_fit_are_named() {
        let w = Window {
            stride: [1, 1],
            padding: Padding::Same,
        };
        let kind = Kind::Depthwise(w, crate::Activation::None);
        let err = infer(&kind, &[&[1, 4, 4, 3], &[1, 3, 3, 2], &[2]]);
        assert!(err.is_err_and(|e| e.contains("[1, 3, 3, 2]")));
        assert!(infer(&Kind::Concat(2), &[&[1, 2], &[1, 2]]).is_err());
        assert!(infer(&Kind::Concat(0), &[]).is_err());
    }
}
