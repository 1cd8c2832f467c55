//! Values of attributes, as far as readers need them. Costs a copy of the value.

use super::types::plain;
use crate::cf;
use hdf5_reader::{Attribute, Datatype, StringSize};

impl cf::Attributes for [Attribute] {
    fn has(&self, name: &str) -> bool {
        named(self, name).is_some()
    }

    fn text(&self, name: &str) -> Option<String> {
        text(self, name)
    }

    fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        numbers(self, name)
    }
}

/// The attribute of a name.
pub(super) fn named<'a>(attributes: &'a [Attribute], name: &str) -> Option<&'a Attribute> {
    attributes.iter().find(|attribute| attribute.name == name)
}

/// A text, also one stored as an array of characters.
pub(super) fn text(attributes: &[Attribute], name: &str) -> Option<String> {
    let attribute = named(attributes, name)?;
    let texts = strings(attribute);
    let is_of_characters = matches!(attribute.datatype, Datatype::String { size: StringSize::Fixed(1), .. });
    let text = if is_of_characters { texts.concat() } else { texts.into_iter().next()? };
    let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
    (!text.is_empty()).then(|| text.to_owned())
}

/// The texts of an array.
pub(super) fn texts(attributes: &[Attribute], name: &str) -> Vec<String> {
    named(attributes, name).map(strings).unwrap_or_default()
}

fn strings(attribute: &Attribute) -> Vec<String> {
    attribute.read_strings().or_else(|_| attribute.read_string().map(|text| vec![text])).unwrap_or_default()
}

/// The numbers of an attribute; `None` if it holds none.
pub(super) fn numbers(attributes: &[Attribute], name: &str) -> Option<Vec<f64>> {
    let attribute = named(attributes, name)?;
    let (element, endian) = plain(&attribute.datatype)?;
    Some(element.numbers(endian, &attribute.raw_data)).filter(|numbers| !numbers.is_empty())
}

/// A single number.
pub(super) fn number(attributes: &[Attribute], name: &str) -> Option<f64> {
    numbers(attributes, name).filter(|numbers| numbers.len() == 1).map(|numbers| numbers[0])
}
