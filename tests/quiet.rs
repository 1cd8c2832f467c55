//! Tests in need of an otherwise idle machine.

mod recovery;
