//! The output's format, by its extension.

use crate::error::MeshError;
use crate::format::{Format, Head};
use crate::glb::Glb;
use crate::obj::Obj;
use crate::ply::Ply;
use crate::stl::Stl;
use std::path::Path;

/// Begins a file of the output's format.
///
/// # Errors
/// If the format is unknown, cannot hold the mesh, or the system refuses the file.
pub(crate) fn begin(output: &Path, head: &Head, holds_several: bool) -> Result<Box<dyn Format>, MeshError> {
    let extension = output.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let extension = extension.as_deref().unwrap_or_default();
    if holds_several && ["stl", "ply"].contains(&extension) {
        let path = output.display();
        let problem =
            format!("{path}: .{extension} holds one object; write all labels to .obj or .glb, or choose one label");
        return Err(MeshError::Unfit(problem));
    }
    if !head.is_single && ["stl", "glb"].contains(&extension) {
        let problem = format!(
            "{}: the 32-bit coordinates of .{extension} are too coarse so far from the origin: vertices would meet; write .ply or .obj",
            output.display()
        );
        return Err(MeshError::Unfit(problem));
    }
    Ok(match extension {
        "stl" => Box::new(Stl::begin(output, head)?),
        "ply" => Box::new(Ply::begin(output, head)?),
        "obj" => Box::new(Obj::begin(output, head)?),
        "glb" => Box::new(Glb::begin(output)?),
        _ => return Err(MeshError::Extension { path: output.into() }),
    })
}
