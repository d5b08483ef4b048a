//! What is worn: fabric, recipe, layers, binding to a body.
