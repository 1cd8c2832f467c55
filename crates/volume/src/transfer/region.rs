//! Regions of the plane of values and gradient magnitudes, each with its own colour and opacity: they separate a boundary from
//! the inside of a thing of the same value.
//!
//! A gradient magnitude is in data units per world unit. A region lies wholly in a box of the plane:
//!
//! | shape | opacity in the box |
//! | --- | --- |
//! | rectangle | the same everywhere |
//! | gaussian | a bell, three standard deviations from its middle to its sides, less its opacity there: so it ends in nothing |
//! | triangle | greatest on the middle value, falling to nothing on the lines from there at no gradient to the upper corners |
//!
//! The triangle is Levoy's (Display of Surfaces from Volume Data, 1988, section 3.1): at a boundary of any steepness the middle
//! value is a layer with the same thickness on each side: half of the box's width in values, divided by its top. Gaussians are
//! ParaView's boxes, but those have a standard deviation of 0.3 sides and are cut off: 1.8 times such a box is one here.

use super::TransferError;
use crate::enum_all::every;
use serde::{Deserialize, Serialize};

/// Shapes of a region's opacity over its box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// The same opacity everywhere.
    Rectangle,
    /// A Gaussian bell: greatest in the middle of the box, and nothing at its sides.
    Gaussian,
    /// Levoy's tent over one value: the steeper the field, the wider the tent.
    Triangle,
}

every!(Shape: Rectangle Gaussian Triangle);

/// Standard deviations from a bell's middle to the sides of its box.
const DEVIATIONS: f64 = 3.0;

/// A region of the plane of values and gradient magnitudes, and the medium there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Shape of the region's opacity over its box.
    pub shape: Shape,
    /// Least and greatest value of the region's box, in data units.
    pub value: [f64; 2],
    /// Least and greatest gradient magnitude of the region's box, in data units per world unit.
    pub gradient: [f64; 2],
    /// Straight colour of the medium, each component in 0..=1.
    pub color: [f64; 3],
    /// Greatest opacity of the medium, collected over the function's `unit_distance`, in 0..=1.
    pub opacity: f64,
}

impl Region {
    /// Opacity of the region over the function's `unit_distance` at a value and a gradient magnitude; 0 outside its box.
    pub fn alpha(&self, value: f64, gradient: f64) -> f64 {
        let ([low, high], [flat, steep]) = (self.value, self.gradient);
        if !(low <= value && value <= high && flat <= gradient && gradient <= steep) {
            return 0.0;
        }
        self.opacity * self.share(value, gradient)
    }

    /// The share of the opacity at a place in the box.
    fn share(&self, value: f64, gradient: f64) -> f64 {
        let from_middle =
            |at: f64, [low, high]: [f64; 2]| if high > low { (2.0 * at - low - high) / (high - low) } else { 0.0 };
        let across = from_middle(value, self.value);
        match self.shape {
            Shape::Rectangle => 1.0,
            Shape::Gaussian => {
                let bell = |squared: f64| (-0.5 * DEVIATIONS * DEVIATIONS * squared).exp();
                let along = from_middle(gradient, self.gradient);
                let rim = bell(1.0);
                ((bell(across * across + along * along) - rim) / (1.0 - rim)).max(0.0)
            }
            Shape::Triangle if gradient > 0.0 => (1.0 - across.abs() * self.gradient[1] / gradient).max(0.0),
            Shape::Triangle => f64::from(u8::from(across == 0.0)),
        }
    }

    /// Checks that the box does not end before its beginning, has no negative magnitude, and that colour and opacity are in range.
    ///
    /// # Errors
    /// The problem of the `index`-th region of its list.
    pub(super) fn check(&self, index: usize) -> Result<(), TransferError> {
        let ([low, high], [flat, steep]) = (self.value, self.gradient);
        let unit = |numbers: &[f64]| numbers.iter().all(|v| (0.0..=1.0).contains(v));
        let problem = if [low, high, flat, steep].iter().any(|v| !v.is_finite()) {
            format!("'value' is {:?} and 'gradient' {:?}: expected finite numbers", self.value, self.gradient)
        } else if low > high {
            format!("'value' ends at {high}, before it begins at {low}")
        } else if flat > steep {
            format!("'gradient' ends at {steep}, before it begins at {flat}")
        } else if flat < 0.0 {
            format!("'gradient' begins at {flat}: a magnitude is at least 0")
        } else if !unit(&self.color) {
            format!("'color' is {:?}: expected three numbers in 0..1", self.color)
        } else if !unit(&[self.opacity]) {
            format!("'opacity' is {}: expected a number in 0..1", self.opacity)
        } else {
            return Ok(());
        };
        Err(TransferError::Point { list: "regions", index, problem })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(shape: Shape) -> Region {
        Region { shape, value: [100.0, 200.0], gradient: [10.0, 50.0], color: [1.0, 0.5, 0.0], opacity: 0.5 }
    }

    #[test]
    fn shapes_have_their_box_and_nothing_outside() {
        for shape in Shape::ALL {
            let region = region(shape);
            assert_eq!(region.alpha(150.0, 30.0), 0.5, "{shape:?}: all of it in the middle");
            for (value, gradient) in [(99.9, 30.0), (200.1, 30.0), (150.0, 9.9), (150.0, 50.1)] {
                assert_eq!(region.alpha(value, gradient), 0.0, "{shape:?} {value} {gradient}");
            }
        }
        assert_eq!(region(Shape::Rectangle).alpha(100.0, 50.0), 0.5, "corners are in a rectangle");
        let bell = |value, gradient| region(Shape::Gaussian).alpha(value, gradient);
        // A standard deviation is a third of the way to a side.
        let expected = 0.5 * ((-0.5f64).exp() - (-4.5f64).exp()) / (1.0 - (-4.5f64).exp());
        assert!((bell(150.0 + 50.0 / 3.0, 30.0) - expected).abs() < 1e-12);
        assert!((bell(150.0, 30.0 - 20.0 / 3.0) - expected).abs() < 1e-12);
        assert!(bell(100.0, 30.0) < 1e-12 && bell(100.0, 10.0) == 0.0, "it ends in nothing");
    }

    /// Levoy's layer: where a field rises by `gradient` a world unit, the value of the middle is shown within a distance of it.
    #[test]
    fn triangles_are_layers_of_one_thickness() {
        let thickness = (200.0 - 100.0) / 2.0 / 50.0;
        for gradient in [10.0, 17.0, 50.0] {
            let at = |distance: f64| region(Shape::Triangle).alpha(150.0 + distance * gradient, gradient);
            for share in [0.0, 0.25, 0.5, 0.99] {
                assert!((at(share * thickness) - 0.5 * (1.0 - share)).abs() < 1e-12, "{gradient} {share}");
                assert!((at(-share * thickness) - 0.5 * (1.0 - share)).abs() < 1e-12, "{gradient} {share}");
            }
            assert_eq!(at(1.001 * thickness), 0.0);
        }
        let flat = Region { gradient: [0.0, 50.0], ..region(Shape::Triangle) };
        assert_eq!([flat.alpha(150.0, 0.0), flat.alpha(150.1, 0.0)], [0.5, 0.0]);
    }

    #[test]
    fn impossible_regions_are_named() {
        assert!(region(Shape::Gaussian).check(0).is_ok());
        let of = || region(Shape::Rectangle);
        let cases = [
            (Region { value: [0.0, f64::INFINITY], ..of() }, "finite"),
            (Region { gradient: [f64::NAN, 1.0], ..of() }, "finite"),
            (Region { value: [3.0, 2.0], ..of() }, "'value' ends at 2, before it begins at 3"),
            (Region { gradient: [3.0, 2.0], ..of() }, "'gradient' ends at 2, before it begins at 3"),
            (Region { gradient: [-1.0, 2.0], ..of() }, "'gradient' begins at -1: a magnitude is at least 0"),
            (Region { color: [0.0, 0.0, 1.5], ..of() }, "'color'"),
            (Region { opacity: f64::NAN, ..of() }, "'opacity' is NaN"),
        ];
        for (region, expected) in cases {
            let found = region.check(3).unwrap_err().to_string();
            assert!(found.starts_with("'regions' point 3: ") && found.contains(expected), "{found}");
        }
    }
}
