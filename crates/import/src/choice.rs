//! Channels and time steps by their callers' words: numbers, names and ranges, before it is known whether an input has them.

use crate::source::SourceInfo;
use brickyard_volume::{counted, near_name};

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
    ///
    /// # Errors
    /// If there is no such channel, or more than one, in words without the choice in front.
    pub fn place(&self, info: &SourceInfo) -> Result<u32, String> {
        let names = names_of(info);
        self.place_among(info.channels, &names)?.ok_or_else(|| {
            let near = near_name::hint(&self.0, names.iter().copied().flatten());
            let known = match names.iter().any(Option::is_some) {
                true => {
                    format!(", named {}", names.iter().map(|name| name.unwrap_or("-")).collect::<Vec<_>>().join(", "))
                }
                false => String::new(),
            };
            format!(
                "no such channel{near}: the input has {}, numbered from 0{known}",
                counted(info.channels.into(), "channel")
            )
        })
    }

    /// The number of the channel, of so many with these names; `None` if there is no such channel. A name in another case counts where no channel
    /// has it as written.
    ///
    /// # Errors
    /// If it is the name of several channels, or the number of one and the name of another; the message tells their numbers.
    pub fn place_among(&self, channels: u32, names: &[Option<&str>]) -> Result<Option<u32>, String> {
        let text = &*self.0;
        let places = |is_it: &dyn Fn(&str) -> bool| {
            let named =
                (0..channels).zip(names).filter(|(_, name)| name.is_some_and(|name| !name.is_empty() && is_it(name)));
            named.map(|(place, _)| place).collect::<Vec<u32>>()
        };
        let named = |text: &str| places(&|name| name == text);
        let in_any_case = |text: &str| places(&|name| name.to_lowercase() == text.to_lowercase());
        let numbered = |text: &str| text.parse::<u32>().ok().filter(|number| *number < channels);
        let (by_number, by_name) = match (text.strip_prefix("number="), text.strip_prefix("name=")) {
            (Some(number), _) => (numbered(number), Vec::new()),
            (_, Some(name)) => (None, named(name)),
            _ => match (numbered(text), named(text)) {
                (None, places) if places.is_empty() => (None, in_any_case(text)),
                found => found,
            },
        };
        match (by_number, &by_name[..]) {
            (number, []) => Ok(number),
            (None, [place]) => Ok(Some(*place)),
            (Some(number), [place]) if number == *place => Ok(Some(number)),
            (Some(number), _) => {
                Err(format!("is the number of a channel and the name of another: write number={number} or name={text}"))
            }
            (None, places) => {
                let numbers: Vec<String> = places.iter().map(u32::to_string).collect();
                Err(format!("is the name of channels {}: give the number of one", numbers.join(", ")))
            }
        }
    }
}

/// The channels' names, as far as they are known.
pub(crate) fn names_of(info: &SourceInfo) -> Vec<Option<&str>> {
    info.channel_looks.iter().map(|look| look.name.as_deref()).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_found_by_number_or_name() {
        let names =
            [Some("DAPI"), None, Some("gfp"), Some("0"), Some("GFP"), Some("rfp"), Some("Rfp"), Some("6"), Some("")];
        let place = |text: &str| text.parse::<ChannelChoice>().unwrap().place_among(9, &names);
        for (text, expected) in [
            ("DAPI", Some(0)),
            ("dapi", Some(0)),
            ("1", Some(1)),
            ("number=0", Some(0)),
            ("name=0", Some(3)),
            ("gfp", Some(2)),
            ("GFP", Some(4)),
            ("name=dapi", None),
            ("number=DAPI", None),
            ("9", None),
            ("-1", None),
            ("name=", None),
            ("actin", None),
        ] {
            assert_eq!(place(text), Ok(expected), "{text}");
        }
        assert!(place("0").unwrap_err().contains("write number=0 or name=0"));
        assert!(place("6").unwrap_err().contains("write number=6 or name=6"));
        assert!(place("RFP").unwrap_err().contains("channels 5, 6: give the number"));
        assert!(place("Gfp").unwrap_err().contains("channels 2, 4: give the number"));
    }
}
