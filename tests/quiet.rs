//! Tests that need the machine for themselves.

mod recovery;
