//! Small networks, forward and back, over one matrix-product crate.
