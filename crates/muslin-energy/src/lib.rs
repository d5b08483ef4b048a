//! The laws: each cloth energy with gradient and Hessian.
