//! The oracle: renders a whole array in f64, plainly.
