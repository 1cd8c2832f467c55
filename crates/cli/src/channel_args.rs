//! `--channel`, and the look of channels: the choice of a store's channels, by number or name, with their window,
//! colour, opacity and gamma.

use super::say::say;
use super::{Failure, heading, values};
use brickyard::channels::{channel_layers, default_layers};
use brickyard::import::ChannelChoice;
use brickyard::session::VolumeSource;
use brickyard::store::{ChannelDisplay, ChannelStatistics, Store};
use brickyard::volume::channel::from_hex;
use brickyard::volume::{MAX_VOLUMES, Scene, SceneLayer, near_name};
use clap::Args;

/// Flags for the choice and look of channels.
#[derive(Args, Clone, Debug)]
pub(crate) struct ChannelArguments {
    /// Channels to show, by number from 0 or by name, separated by commas; or all [default: the store's active ones]
    #[arg(help_heading = heading::PART, long, value_name = "all|CHANNEL,...")]
    channel: Option<String>,
    /// Values shown as black and as full colour, of all channels or of one; as percentiles with % [default: the
    /// store's]
    #[arg(help_heading = heading::LOOK, long, value_name = "[CHANNEL=]LOW,HIGH", value_parser = |text: &str| setting(text, window), allow_hyphen_values = true)]
    window: Vec<Setting<[Bound; 2]>>,
    /// From black to this colour over the window, of all channels or of one: a name, RRGGBB, or R:G:B in 0..1 [default:
    /// the store's, or the transfer function's]
    #[arg(help_heading = heading::LOOK, long, value_name = "[CHANNEL=]COLOR", value_parser = |text: &str| setting(text, color))]
    color: Vec<Setting<[f64; 3]>>,
    /// Factor of opacities, 0..1, of all channels or of one; in projections the opacity of the whole channel [default:
    /// 1]
    #[arg(help_heading = heading::LOOK, long, value_name = "[CHANNEL=]OPACITY", value_parser = |text: &str| setting(text, number), allow_hyphen_values = true)]
    opacity: Vec<Setting<f64>>,
    /// Exponent of a channel over its window; less than 1 shows more of the lesser values [default: 1]
    #[arg(help_heading = heading::LOOK, long, value_name = "[CHANNEL=]GAMMA", value_parser = |text: &str| setting(text, number), allow_hyphen_values = true)]
    gamma: Vec<Setting<f64>>,
    /// Labels to show, separated by commas; of labels [default: all but the background, 0]
    #[arg(help_heading = heading::PART, long, value_name = "[CHANNEL=]LABEL,...", value_parser = |text: &str| setting(text, values::labels), allow_hyphen_values = true)]
    show_labels: Vec<Setting<Vec<i64>>>,
}

/// A value for the layers of one channel, or of all.
#[derive(Clone, Debug, PartialEq)]
struct Setting<T> {
    /// The channel's number or name as written; `None` is every channel.
    channel: Option<String>,
    value: T,
}

/// An end of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Bound {
    /// In stored units.
    Value(f64),
    /// A percentile, 0 to 100.
    Percent(f64),
}

/// Named colours: red, green and blue, each 0 to 1.
const COLORS: [(&str, [f64; 3]); 9] = [
    ("white", [1.0, 1.0, 1.0]),
    ("gray", [1.0, 1.0, 1.0]),
    ("red", [1.0, 0.0, 0.0]),
    ("green", [0.0, 1.0, 0.0]),
    ("blue", [0.0, 0.0, 1.0]),
    ("cyan", [0.0, 1.0, 1.0]),
    ("magenta", [1.0, 0.0, 1.0]),
    ("yellow", [1.0, 1.0, 0.0]),
    ("orange", [1.0, 0.5, 0.0]),
];

fn number(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("'{text}': expected a number"))
}

/// Reads `LOW,HIGH` or `LOW:HIGH`, each a value or a percentile.
fn window(text: &str) -> Result<[Bound; 2], String> {
    let form = || format!("'{text}': expected LOW,HIGH, each a value or a percentile, as in 100,4000 or 1%,99.5%");
    let (low, high) = text.split_once([',', ':']).ok_or_else(form)?;
    let bound = |text: &str| match text.trim().strip_suffix('%') {
        Some(percent) => match percent.trim().parse::<f64>() {
            Ok(percent) if (0.0..=100.0).contains(&percent) => Ok(Bound::Percent(percent)),
            _ => Err(format!("'{}': expected a percentile of 0% to 100%", text.trim())),
        },
        None => text.trim().parse().ok().filter(|v: &f64| v.is_finite()).map(Bound::Value).ok_or_else(form),
    };
    let bounds = [bound(low)?, bound(high)?];
    match bounds {
        [Bound::Value(low), Bound::Value(high)] | [Bound::Percent(low), Bound::Percent(high)] if low >= high => {
            let is_empty = low == high;
            Err(if is_empty {
                format!("'{text}': the window is empty: expected two different ends, the lesser one first")
            } else {
                format!("'{text}': the window is upside down: expected the lesser end first")
            })
        }
        _ => Ok(bounds),
    }
}

/// Reads a colour's name, six hexadecimal digits, or three numbers.
pub(crate) fn color(text: &str) -> Result<[f64; 3], String> {
    if let Some((_, color)) = COLORS.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)) {
        return Ok(*color);
    }
    if let Some(color) = from_hex(text.trim_start_matches('#')) {
        return Ok(color.map(|part| f64::from(part) / 255.0));
    }
    if text.contains([':', ',']) {
        return values::color(&text.replace(':', ","));
    }
    let names = COLORS.map(|(name, _)| name);
    let near = near_name::hint(text, names.into_iter());
    Err(format!("no colour '{text}'{near}: expected RRGGBB, R:G:B, or one of {}", names.join(", ")))
}

/// Reads `[CHANNEL=]VALUE`. Names may contain equals signs, values do not.
fn setting<T>(text: &str, read: impl Fn(&str) -> Result<T, String>) -> Result<Setting<T>, String> {
    let (channel, value) = match text.rsplit_once('=') {
        Some((channel, value)) => (Some(channel.trim().to_string()), value),
        None => (None, text),
    };
    Ok(Setting { channel, value: read(value.trim())? })
}

impl ChannelArguments {
    /// Sets the layers of a scene, one for each shown channel; or, if a scene file lists layers, their channel.
    ///
    /// # Errors
    /// If a store lacks a channel, or more are chosen than a picture can have.
    pub(super) fn set_layers(
        &self,
        scene: &mut Scene,
        volumes: &[VolumeSource],
        lists_layers: bool,
    ) -> Result<(), Failure> {
        if lists_layers {
            return self.choose_of_all(scene, volumes);
        }
        let Some(text) = self.channel.as_deref() else {
            scene.layers = default_layers(volumes);
            let channels: u64 = volumes.iter().map(|volume| u64::from(volume.source.channels())).sum();
            if scene.layers.len() == MAX_VOLUMES && channels > MAX_VOLUMES as u64 {
                say!(
                    "note: a picture shows at most {MAX_VOLUMES} of the {channels} channels: choose others with \
                     --channel"
                );
            }
            return Ok(());
        };
        scene.layers.clear();
        let has_image = volumes.iter().any(|volume| !volume.source.is_labels());
        for (i, volume) in volumes.iter().enumerate() {
            // Channels are an image's, where labels are shown over it.
            let channels = if has_image && volume.source.is_labels() { vec![0] } else { chosen(text, volume)? };
            scene.layers.extend(channel_layers(i, volume, &channels));
        }
        match scene.layers.len() {
            count if count > MAX_VOLUMES => {
                Err(Failure::usage(format!("--channel: {count} channels: a picture shows at most {MAX_VOLUMES}")))
            }
            _ => Ok(()),
        }
    }

    /// Sets one channel for all layers, where the scene lists them.
    fn choose_of_all(&self, scene: &mut Scene, volumes: &[VolumeSource]) -> Result<(), Failure> {
        let Some(text) = self.channel.as_deref() else { return Ok(()) };
        for i in 0..scene.layers.len() {
            let Some(volume) = volumes.get(scene.store(i)) else { continue };
            let [channel] = chosen(text, volume)?[..] else {
                let problem = "--channel: the scene file lists its layers: one channel can be set for all of them";
                return Err(Failure::usage(problem));
            };
            scene.layers[i].channel = channel;
        }
        Ok(())
    }

    /// Sets windows, colours, opacities, gammas and labels of a scene's layers. In a scene of both measurements and
    /// labels, windows and gammas without a channel apply to measurements.
    ///
    /// # Errors
    /// If no layer shows a named channel, both percentiles are one value, or a label does not exist.
    pub(super) fn set_looks(&self, scene: &mut Scene, volumes: &[VolumeSource]) -> Result<(), Failure> {
        each(&self.window, "--window", Suits::Measurements, scene, volumes, |layer, bounds, volume| {
            layer.window = Some(found_window(*bounds, volume.statistics(layer.channel), layer.channel)?);
            Ok(())
        })?;
        each(&self.color, "--color", Suits::All, scene, volumes, |layer, color, _| {
            layer.color = Some(*color);
            Ok(())
        })?;
        each(&self.opacity, "--opacity", Suits::All, scene, volumes, |layer, opacity, _| {
            layer.opacity = *opacity;
            Ok(())
        })?;
        each(&self.gamma, "--gamma", Suits::Measurements, scene, volumes, |layer, gamma, _| {
            layer.gamma = *gamma;
            Ok(())
        })?;
        each(&self.show_labels, "--show-labels", Suits::Labels, scene, volumes, |layer, labels, volume| {
            check_labels("--show-labels", labels, volume, layer.channel)?;
            layer.show_labels = Some(labels.clone());
            Ok(())
        })
    }
}

/// The layers for a flag without a channel.
#[derive(Clone, Copy, PartialEq)]
enum Suits {
    All,
    Measurements,
    Labels,
}

/// Returns the layers for a flag for measurements, or for labels: all of that kind, or all layers if there are none, so
/// they are refused by name.
pub(super) fn layers_of_kind(scene: &Scene, volumes: &[VolumeSource], is_labels: bool) -> Vec<usize> {
    let is_it = |&i: &usize| volumes.get(scene.store(i)).is_some_and(|volume| volume.source.is_labels() == is_labels);
    let all = 0..scene.layers.len();
    let found: Vec<usize> = all.clone().filter(is_it).collect();
    if found.is_empty() { all.collect() } else { found }
}

/// Checks whether a channel may have these labels, by its range and its counts by value.
///
/// # Errors
/// Exit code 2, naming near labels, for the first that the channel cannot have.
pub(super) fn check_labels(flag: &str, labels: &[i64], volume: &VolumeSource, channel: u32) -> Result<(), Failure> {
    let Some(store) = volume.store().filter(|_| volume.source.is_labels()) else { return Ok(()) };
    let Some(label) = labels.iter().find(|&&label| !store.may_have_label(channel, label)) else { return Ok(()) };
    let (low, high) = volume.source.channel_range(channel);
    let [below, above] = [-1i64, 1].map(|step| {
        let mut others = (1..=LABELS_AROUND).map(|i| label.saturating_add(i * step));
        others.find(|&other| other != 0 && store.may_have_label(channel, other))
    });
    let near = match (below, above) {
        (Some(a), Some(b)) => format!(", did you mean {a} or {b}?"),
        (Some(a), None) | (None, Some(a)) => format!(", did you mean {a}?"),
        (None, None) => String::new(),
    };
    Err(Failure::usage(format!("{flag}: no label {label}{near}: the store has labels from {low} to {high}")))
}

/// Distance within which existing labels are suggested for a missing one.
const LABELS_AROUND: i64 = 100;

/// Applies settings to their layers.
fn each<T>(
    settings: &[Setting<T>],
    flag: &str,
    suits: Suits,
    scene: &mut Scene,
    volumes: &[VolumeSource],
    apply: impl Fn(&mut SceneLayer, &T, &VolumeSource) -> Result<(), Failure>,
) -> Result<(), Failure> {
    for Setting { channel, value } in settings {
        let mut is_used = false;
        let layers = match suits {
            _ if suits == Suits::All || channel.is_some() => (0..scene.layers.len()).collect(),
            _ => layers_of_kind(scene, volumes, suits == Suits::Labels),
        };
        for i in layers {
            let Some(volume) = volumes.get(scene.store(i)) else { continue };
            let layer = &mut scene.layers[i];
            let is_meant = match channel {
                Some(name) => {
                    let refuse = |problem| Failure::usage(format!("{flag} {name}=...: {problem}"));
                    find(name, &names(volume.displays())).map_err(refuse)? == Some(layer.channel)
                }
                None => true,
            };
            if is_meant {
                apply(layer, value, volume)?;
                is_used = true;
            }
        }
        if let (false, Some(name)) = (is_used, channel) {
            let known = volumes.first().map_or_else(String::new, |volume| known_channels(&names(volume.displays())));
            return Err(Failure::usage(format!("{flag} {name}=...: no channel '{name}' is shown: {known}")));
        }
    }
    Ok(())
}

/// Returns the values at a window's ends.
fn found_window(bounds: [Bound; 2], statistics: Option<&ChannelStatistics>, channel: u32) -> Result<[f64; 2], Failure> {
    let value = |bound| match (bound, statistics) {
        (Bound::Value(value), _) => Some(value),
        (Bound::Percent(percent), Some(statistics)) => Some(statistics.percentile(percent)),
        (Bound::Percent(_), None) => None,
    };
    match bounds.map(value) {
        [Some(low), Some(high)] if low < high => Ok([low, high]),
        [Some(low), Some(high)] => Err(Failure::usage(format!(
            "--window: the lower end of channel {channel} is {low} and the upper end {high}: give values, or \
             percentiles further apart"
        ))),
        _ => Err(Failure::usage(format!("--window: percentiles of channel {channel} are not known: give values"))),
    }
}

fn chosen(text: &str, volume: &VolumeSource) -> Result<Vec<u32>, Failure> {
    if text == "all" {
        return Ok((0..volume.source.channels()).collect());
    }
    let names = names(volume.displays());
    // A name may contain a comma.
    if let Ok(Some(channel)) = find(text, &names) {
        return Ok(vec![channel]);
    }
    text.split(',').map(|name| place_of(name.trim(), &names)).collect()
}

/// The number of a store's channel for `--channel`.
///
/// # Errors
/// If there is no such channel, or several.
pub(crate) fn channel_of(text: &str, store: &Store) -> Result<u32, Failure> {
    place_of(text, &names(store.channel_displays()))
}

fn place_of(text: &str, names: &[Option<&str>]) -> Result<u32, Failure> {
    let found = find(text, names).map_err(|problem| Failure::usage(format!("--channel {text}: {problem}")))?;
    found.ok_or_else(|| {
        let near = near_name::hint(text, names.iter().copied().flatten());
        Failure::usage(format!("--channel: no channel '{text}'{near}: {}", known_channels(names)))
    })
}

/// The number of the channel with this name or number; `None` if there is none.
///
/// # Errors
/// If there are several.
fn find(text: &str, names: &[Option<&str>]) -> Result<Option<u32>, String> {
    text.parse::<ChannelChoice>()?.place_among(names.len() as u32, names)
}

fn names(displays: &[ChannelDisplay]) -> Vec<Option<&str>> {
    displays.iter().map(|display| display.name.as_deref()).collect()
}

/// Lists the existing channels in words.
fn known_channels(names: &[Option<&str>]) -> String {
    let name = |(i, name): (usize, &Option<&str>)| name.map_or_else(|| i.to_string(), |name| format!("{i} '{name}'"));
    let each: Vec<_> = names.iter().enumerate().map(name).collect();
    format!("the store's channels are {}", each.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_for_one_channel_or_for_all() {
        let found = setting("a=b=1%,99.5%", window).unwrap();
        assert_eq!(found, Setting { channel: Some("a=b".into()), value: [Bound::Percent(1.0), Bound::Percent(99.5)] });
        let found = setting("-3:7", window).unwrap();
        assert_eq!(found, Setting { channel: None, value: [Bound::Value(-3.0), Bound::Value(7.0)] });
        let bad = [
            ("7,3", "upside down"),
            ("9%,3%", "upside down"),
            ("-1%,99%", "0% to 100%"),
            ("1%,101%", "0% to 100%"),
            ("7", "LOW,HIGH"),
            ("nan,3", "LOW,HIGH"),
        ];
        for (bad, word) in bad {
            assert!(setting(bad, window).unwrap_err().contains(word), "{bad}");
        }
    }

    #[test]
    fn colours_have_names_digits_or_numbers() {
        let found = ["Cyan", "#0000ff", "1:0.5:0"].map(|text| color(text).unwrap());
        assert_eq!(found, [[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.5, 0.0]]);
        assert!(color("gren").unwrap_err().contains("did you mean 'green'?"));
        assert!(color("1:0").is_err());
    }

    #[test]
    fn channels_have_numbers_and_names() {
        let names = [Some("DAPI"), None, Some("gfp"), Some("gfp")];
        let place = |text: &str| place_of(text, &names).map_err(|failure| failure.message);
        assert_eq!(
            ["DAPI", "dapi", "1", "number=3"].map(|text| place(text).ok()),
            [Some(0), Some(0), Some(1), Some(3)]
        );
        let problem = place("dap").unwrap_err();
        assert_eq!(
            problem,
            "--channel: no channel 'dap', did you mean 'DAPI'?: the store's channels are 0 'DAPI', 1, 2 'gfp', 3 'gfp'"
        );
        assert_eq!(place("gfp").unwrap_err(), "--channel gfp: is the name of channels 2, 3: give the number of one");
        assert!(place("").unwrap_err().contains("the number or the name"));
    }
}
