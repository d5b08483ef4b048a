//! Moves cloth by minimising the energies around moving triangles.
