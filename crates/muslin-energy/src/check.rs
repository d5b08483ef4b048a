//! The suite that a law must pass.
