//! The expression of a scene over its volumes, and how its values look.

use crate::scene_check::check_expression;
use crate::session_error::SessionError;
use crate::volume_source::{VolumeSource, default_transfer};
use brickyard_volume::{Blend, Combination, Expression, Scene, VolumeLook};

/// The scene's expression, if it has one.
pub(crate) fn expression(
    volumes: &[VolumeSource],
    looks: &[VolumeLook],
    scene: &Scene,
) -> Result<Option<Expression>, SessionError> {
    let Some(text) = &scene.expression else { return Ok(None) };
    check_expression(scene)?;
    let of_expression = |problem: String| SessionError::Scene(format!("expression: {problem}"));
    let expression = Expression::parse(text, volumes.len()).map_err(|error| of_expression(error.to_string()))?;
    let read = expression.volumes();
    let has_own_look = |look: &VolumeLook| {
        let is_own = look.transfer.is_some() || look.opacity != 1.0 || look.blend != Blend::Mix;
        is_own || !look.isosurfaces.is_empty()
    };
    let problem = if read.is_empty() {
        format!("'{text}' reads no volume: there is nothing to show")
    } else if let Some(i) = read.iter().find(|i| !looks[**i].visible) {
        format!("it reads volume {i}, which is not visible: leave one of both out")
    } else if let Some(i) = looks.iter().position(has_own_look) {
        let problem = "has a look of its own, and the expression's value has the scene's";
        format!("volume {i} {problem}: leave its transfer, opacity, blend and isosurfaces out")
    } else {
        return Ok(Some(expression));
    };
    Err(of_expression(problem))
}

/// An expression and how its values look: as the scene says, or on a gray ramp over all that they can be.
pub(crate) fn combination(expression: Expression, volumes: &[VolumeSource], scene: &Scene) -> Combination {
    let source = &volumes[expression.volumes()[0]].source;
    let (geometry, extent) = (source.geometry(), source.pyramid().levels()[0].extent);
    let window = expression_window(&expression, volumes.iter().map(|volume| volume.default_window));
    let transfer = scene.transfer.clone().unwrap_or_else(|| default_transfer(window, geometry, extent));
    Combination::new(expression.of_its_own(), transfer)
}

/// The values that an expression can have of volumes with values in these windows; zero to one where that has no end.
pub fn expression_window(expression: &Expression, windows: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let windows: Vec<_> = windows.map(|(low, high)| Some([low, high])).collect();
    match expression.range(&windows) {
        Some([low, high]) if low < high && (high - low).is_finite() => (low, high),
        // Shown as a volume of one value is.
        Some([value, _]) if value.is_finite() => (value, value),
        _ => (0.0, 1.0),
    }
}
