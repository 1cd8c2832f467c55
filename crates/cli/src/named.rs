//! Values of a flag by their names: one table serves the parser, the help and the completions.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command, Error};
use std::ffi::OsStr;

/// Values, each with its name on the command line and a help text, which may be empty.
#[derive(Clone, Copy)]
pub(crate) struct Named<T: 'static>(pub(crate) &'static [(&'static str, T, &'static str)]);

impl<T: PartialEq> Named<T> {
    /// The name of a value; empty for one without.
    pub(crate) fn name(&self, value: &T) -> &'static str {
        self.0.iter().find(|(_, known, _)| known == value).map_or("", |(name, ..)| *name)
    }
}

impl<T: Copy + Send + Sync + 'static> TypedValueParser for Named<T> {
    type Value = T;

    fn parse_ref(&self, command: &Command, argument: Option<&Arg>, text: &OsStr) -> Result<T, Error> {
        let known = PossibleValuesParser::new(self.0.iter().map(|(name, ..)| *name));
        let name = known.parse_ref(command, argument, text)?;
        let found = self.0.iter().find(|(known, ..)| *known == name);
        found.map(|(_, value, _)| *value).ok_or_else(|| Error::new(clap::error::ErrorKind::InvalidValue))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.0.iter().map(|(name, _, help)| match *help {
            "" => PossibleValue::new(*name),
            help => PossibleValue::new(*name).help(help),
        })))
    }
}
