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
    check_name(output, holds_several)?;
    let extension = extension_of(output);
    let extension = extension.as_str();
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
        "glb" => Box::new(Glb::begin(output, head)?),
        _ => return Err(MeshError::Extension { path: output.into() }),
    })
}

/// Checks whether a name has a format, which holds several objects if there are any.
///
/// # Errors
/// If not.
pub(crate) fn check_name(output: &Path, holds_several: bool) -> Result<(), MeshError> {
    let extension = extension_of(output);
    match extension.as_str() {
        "stl" | "ply" if holds_several => {
            let path = output.display();
            let problem =
                format!("{path}: .{extension} holds one object; write all labels to .obj or .glb, or choose one label");
            Err(MeshError::Unfit(problem))
        }
        "stl" | "ply" | "obj" | "glb" => Ok(()),
        _ => Err(MeshError::Extension { path: output.into() }),
    }
}

fn extension_of(output: &Path) -> String {
    output.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}
