//! The default look of a channel: name, colour, window and unit, read from a file and kept in stores.

use serde::{Deserialize, Serialize};

/// Default colours of an image's several channels, as red, green and blue; they repeat after the last.
pub const PALETTE: [[u8; 3]; 6] = [[0, 255, 0], [255, 0, 255], [0, 255, 255], [255, 255, 0], [255, 0, 0], [0, 0, 255]];

/// A channel's name, colour, window and unit, as far as its source gives them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChannelLook {
    /// The channel's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The channel's colour: red, green and blue.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[u8; 3]>,
    /// The values shown as black and as the full colour, in stored units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<[f64; 2]>,
    /// The unit of the stored values: free text, checked by [`free_unit`](crate::units::free_unit).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// The default colour of a channel of `channels`: one of [`PALETTE`]; white for a single channel.
pub fn default_color(channel: usize, channels: usize) -> [u8; 3] {
    if channels > 1 { PALETTE[channel % PALETTE.len()] } else { [255; 3] }
}

/// Formats a colour as six hexadecimal digits: red, green and blue.
pub fn hex(color: [u8; 3]) -> String {
    color.map(|part| format!("{part:02X}")).concat()
}

/// Parses a colour of six hexadecimal digits; `None` for anything else.
pub fn from_hex(text: &str) -> Option<[u8; 3]> {
    let is_hex = text.len() == 6 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
    let part = |i: usize| u8::from_str_radix(text.get(2 * i..2 * i + 2)?, 16).ok();
    if is_hex { Some([part(0)?, part(1)?, part(2)?]) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_channel_is_white_and_several_have_a_palette() {
        assert_eq!(
            [default_color(0, 1), default_color(1, 2), default_color(7, 9)],
            [[255; 3], [255, 0, 255], [255, 0, 255]]
        );
    }

    #[test]
    fn hexadecimal_colours_are_read_as_they_are_written() {
        assert_eq!((hex([0, 171, 255]), from_hex("00abFF")), ("00ABFF".into(), Some([0, 171, 255])));
        for bad in ["", "fff", "00000g", "+00000", "ffffff0", "é0000"] {
            assert_eq!(from_hex(bad), None, "{bad}");
        }
    }
}
