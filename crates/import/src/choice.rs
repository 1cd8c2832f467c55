//! Channels and time steps by their callers' words: numbers, names and ranges, before it is known whether an input has them.

use crate::source::SourceInfo;
use brickyard_volume::{ChannelLook, counted};

/// Time steps in order, a fixed number apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepChoice {
    /// The first step.
    pub first: u32,
    /// The end, excluded; `None` is the input's.
    pub end: Option<u32>,
    /// Steps from one to the next, at least 1.
    pub stride: u32,
}

impl std::fmt::Display for StepChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let end = self.end.map_or(String::new(), |end| end.to_string());
        write!(f, "{}:{end}:{}", self.first, self.stride)
    }
}

/// A channel by its number or its name, as in `0`, `DAPI`, `number=1`, `name=488`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ChannelChoice(String);

impl ChannelChoice {
    /// The channel of this number, counted from 0.
    pub fn number(number: u32) -> Self {
        Self(format!("number={number}"))
    }

    /// The channel of this name.
    pub fn name(name: &str) -> Self {
        Self(format!("name={name}"))
    }

    /// The number of the channel in an input with these looks.
    pub(crate) fn place(&self, info: &SourceInfo) -> Result<u32, String> {
        let (text, channels) = (&self.0, info.channels);
        let name_of = |look: &ChannelLook| look.name.clone().unwrap_or_default();
        let names: Vec<String> = info.channel_looks.iter().map(name_of).collect();
        let named = |name: &str| {
            let places = (0..channels).zip(&names).filter(|(_, found)| !name.is_empty() && *found == name);
            places.map(|(place, _)| place).collect::<Vec<u32>>()
        };
        let numbered = |text: &str| text.parse::<u32>().ok().filter(|number| *number < channels);
        let (by_number, by_name) = match (text.strip_prefix("number="), text.strip_prefix("name=")) {
            (Some(number), _) => (numbered(number), Vec::new()),
            (_, Some(name)) => (None, named(name)),
            _ => (numbered(text), named(text)),
        };
        match (by_number, &by_name[..]) {
            (Some(number), []) => Ok(number),
            (Some(number), [place]) if number == *place => Ok(number),
            (None, [place]) => Ok(*place),
            (None, []) => {
                let known = match names.iter().any(|name| !name.is_empty()) {
                    true => format!(", named {}", names.join(", ")),
                    false => String::new(),
                };
                Err(format!("the input has {}, numbered from 0{known}", counted(channels.into(), "channel")))
            }
            (Some(number), _) => {
                Err(format!("is the number of a channel and the name of another: write number={number} or name={text}"))
            }
            (None, places) => Err(format!("is the name of channels {places:?}: give the number")),
        }
    }
}

impl std::str::FromStr for ChannelChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.trim() {
            "" => Err("expected the number or the name of a channel".into()),
            text => Ok(Self(text.into())),
        }
    }
}

impl std::fmt::Display for ChannelChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}
