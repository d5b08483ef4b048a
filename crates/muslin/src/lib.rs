//! The jobs as plain functions.
