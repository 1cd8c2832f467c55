//! Default layers for the channels of volumes, each in the window and colour of its volume, from metadata alone.

use crate::session::volume_source::VolumeSource;
use brickyard_volume::{MAX_VOLUMES, SceneLayer};

/// Returns a layer for every visible channel of every volume, in the order of volumes and channels. A single volume
/// yields at most its first [`MAX_VOLUMES`]; several volumes yield all, even if they exceed a scene's limit.
pub fn default_layers(volumes: &[VolumeSource]) -> Vec<SceneLayer> {
    let of_volume = |(i, volume): (usize, &VolumeSource)| channel_layers(i, volume, &visible_channels(volume));
    let most = if volumes.len() == 1 { MAX_VOLUMES } else { usize::MAX };
    volumes.iter().enumerate().flat_map(of_volume).take(most).collect()
}

/// Returns layers for these channels of the session's volume at `index`. Channels of a multi-channel image have their
/// colours. Their blend depends on the mode: see [`Scene::blend`](brickyard_volume::Scene::blend).
pub fn channel_layers(index: usize, volume: &VolumeSource, channels: &[u32]) -> Vec<SceneLayer> {
    let layer = |&channel: &u32| SceneLayer {
        source: Some(index),
        channel,
        color: color(volume, channel),
        ..SceneLayer::default()
    };
    channels.iter().map(layer).collect()
}

/// Returns the channels shown by default: the first of labels, otherwise those marked as visible, or all if none is.
fn visible_channels(volume: &VolumeSource) -> Vec<u32> {
    let all = 0..volume.source.channels();
    if volume.source.is_labels() {
        return vec![0];
    }
    let displays = volume.displays();
    // A black channel, such as the opacity of a photograph, shows nothing, and would only absorb light.
    let is_shown = |&channel: &u32| {
        let display = &displays[channel as usize];
        display.is_visible && display.color != [0; 3]
    };
    let active: Vec<u32> = all.clone().filter(is_shown).collect();
    if active.is_empty() { all.collect() } else { active }
}

/// Returns the colour of a channel in place of a gray ramp; `None` leaves it white.
fn color(volume: &VolumeSource, channel: u32) -> Option<[f64; 3]> {
    let color = volume.displays()[channel as usize].color;
    (color != [255; 3]).then(|| color.map(|part| f64::from(part) / 255.0))
}
