//! The layers that show the channels of volumes unless a scene says otherwise: each in the window and colour that its volume gives it.
//! They are made from metadata alone.

use crate::session::volume_source::VolumeSource;
use brickyard_volume::{MAX_VOLUMES, SceneLayer};

/// The layers that show every visible channel of every volume, in volumes' and channels' order. Of a single volume they are the first
/// [`MAX_VOLUMES`]; of several volumes none is left out, even if there are more than a scene may have.
pub fn default_layers(volumes: &[VolumeSource]) -> Vec<SceneLayer> {
    let of_volume = |(i, volume): (usize, &VolumeSource)| channel_layers(i, volume, &visible_channels(volume));
    let most = if volumes.len() == 1 { MAX_VOLUMES } else { usize::MAX };
    volumes.iter().enumerate().flat_map(of_volume).take(most).collect()
}

/// The layers that show these channels of the volume with this index among the session's. The channels of an image that has several have
/// their colours. How they join follows from the mode: see [`Scene::blend`](brickyard_volume::Scene::blend).
pub fn channel_layers(index: usize, volume: &VolumeSource, channels: &[u32]) -> Vec<SceneLayer> {
    let layer = |&channel: &u32| SceneLayer {
        source: Some(index),
        channel,
        color: color(volume, channel),
        ..SceneLayer::default()
    };
    channels.iter().map(layer).collect()
}

/// The channels that are shown unless somebody chooses others: the first of labels, else those that are marked as visible, or all if
/// none is.
fn visible_channels(volume: &VolumeSource) -> Vec<u32> {
    let all = 0..volume.source.channels();
    if volume.source.is_labels() {
        return vec![0];
    }
    let displays = volume.displays();
    // A black channel, such as the opacity of a photograph, shows nothing, and would only take light.
    let is_shown = |&channel: &u32| {
        let display = &displays[channel as usize];
        display.is_visible && display.color != [0; 3]
    };
    let active: Vec<u32> = all.clone().filter(is_shown).collect();
    if active.is_empty() { all.collect() } else { active }
}

/// The colour that a channel has in place of a gray ramp's; `None` leaves it white.
fn color(volume: &VolumeSource, channel: u32) -> Option<[f64; 3]> {
    let color = volume.displays()[channel as usize].color;
    (color != [255; 3]).then(|| color.map(|part| f64::from(part) / 255.0))
}
