//! `--volume N:KEY=VALUE`: the look of one layer. Values have the same form as in flags for all layers.

use super::{Failure, values};
use brickyard::text_file::read_text;
use brickyard::volume::{Blend, Placement, PlacementError, Scene, SceneLayer, TransferChoice, TransferFile, counted};
use clap::ValueEnum;
use std::path::Path;

/// One setting of one layer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct VolumeSetting {
    layer: usize,
    pub(crate) key: VolumeKey,
    value: String,
}

/// The keys, by their names in kebab case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum VolumeKey {
    Transfer,
    Matrix,
    Window,
    Color,
    Gamma,
    ShowLabels,
    Blend,
    Opacity,
    Isovalue,
    Crop,
    Channel,
    Visible,
}

/// Reads `N:KEY=VALUE`.
pub(crate) fn volume_setting(text: &str) -> Result<VolumeSetting, String> {
    let form = || format!("'{text}': expected N:KEY=VALUE, as in 1:blend=add");
    let (layer, rest) = text.split_once(':').ok_or_else(form)?;
    let (key, value) = rest.split_once('=').ok_or_else(form)?;
    let layer = layer.trim().parse().map_err(|_| form())?;
    let key = VolumeKey::from_str(key.trim(), false).map_err(|_| {
        let known = VolumeKey::value_variants().iter().filter_map(VolumeKey::to_possible_value);
        let names: Vec<_> = known.map(|known| known.get_name().to_owned()).collect();
        format!("'{text}': no '{}': expected one of {}", key.trim(), names.join(", "))
    })?;
    let setting = VolumeSetting { layer, key, value: value.trim().to_string() };
    // Faults of the text itself are reported at once.
    setting.key.set(&mut SceneLayer::default(), &setting.value).map(|()| setting)
}

impl VolumeSetting {
    pub(crate) fn layer<'a>(&self, scene: &'a mut Scene) -> Result<&'a mut SceneLayer, Failure> {
        let (layer, count) = (self.layer, counted(scene.layers.len() as u64, "layer"));
        let missing =
            || Failure::usage(format!("--volume {layer}:...: no such layer: the scene has {count}, numbered from 0"));
        scene.layers.get_mut(layer).ok_or_else(missing)
    }

    pub(crate) fn apply(&self, scene: &mut Scene) -> Result<(), Failure> {
        let layer = self.layer(scene)?;
        match self.key {
            VolumeKey::Transfer => set_transfer(layer, transfer_choice(&self.value)),
            VolumeKey::Matrix => {
                let flag = format!("--volume {}:matrix={}", self.layer, self.value);
                layer.world_from_volume = placement(&self.value, &flag)?;
            }
            key => key
                .set(layer, &self.value)
                .map_err(|error| Failure::usage(format!("--volume {}: {error}", self.layer)))?,
        }
        Ok(())
    }
}

/// Gives a layer a transfer function, including its colours.
pub(crate) fn set_transfer(layer: &mut SceneLayer, choice: TransferChoice) {
    (layer.transfer, layer.color) = (Some(choice), None);
}

/// Returns the file of `FILE` or `FILE#NAME` if it exists, else a preset of this name.
pub(crate) fn transfer_choice(argument: &str) -> TransferChoice {
    let whole = (argument, None);
    let parts = argument.match_indices('#').map(|(i, _)| (&argument[..i], Some(&argument[i + 1..])));
    match std::iter::once(whole).chain(parts).find(|(path, _)| Path::new(path).is_file()) {
        Some((path, name)) => {
            TransferChoice::File(TransferFile { path: path.into(), name: name.map(Into::into), function: None })
        }
        None => TransferChoice::preset(argument),
    }
}

/// Reads the placement in a file, or in the text itself, given by `flag`.
pub(crate) fn placement(value: &str, flag: &str) -> Result<Placement, Failure> {
    let path = Path::new(value);
    let text = if path.is_file() { read_text(path).map_err(Failure::bad_input)? } else { value.to_string() };
    let what = if path.is_file() { path.display().to_string() } else { flag.to_string() };
    Placement::from_text(&text).map_err(|error| match error {
        PlacementError::Word(_) if !path.is_file() => {
            Failure::bad_input(format!("{what}: neither a file nor the 12 or 16 numbers of a matrix, row by row"))
        }
        error => Failure::bad_input(format!("{what}: {error}")),
    })
}

impl VolumeKey {
    /// Sets the value, or adds an isosurface; ignores a transfer function and a matrix, which need more than the text.
    fn set(self, layer: &mut SceneLayer, value: &str) -> Result<(), String> {
        match self {
            Self::Transfer | Self::Matrix => {}
            Self::Window => layer.window = Some(values::window(value)?),
            Self::Color => layer.color = Some(values::color(&value.replace(':', ","))?),
            Self::Gamma => layer.gamma = values::positive(value)?,
            Self::ShowLabels => layer.show_labels = Some(values::labels(value)?),
            Self::Blend => {
                layer.blend = match value {
                    "auto" => None,
                    "mix" => Some(Blend::Mix),
                    "add" => Some(Blend::Add),
                    "over" => Some(Blend::Over),
                    _ => return Err(format!("blend '{value}': expected auto, mix, add or over")),
                }
            }
            Self::Opacity => {
                let opacity = value.parse::<f64>().ok().filter(|opacity| (0.0..=1.0).contains(opacity));
                layer.opacity = opacity.ok_or_else(|| format!("opacity '{value}': expected a number from 0 to 1"))?;
            }
            Self::Isovalue => layer.isosurfaces.push(values::isosurface(value)?),
            Self::Crop => layer.crop = Some(values::corners(value)?),
            Self::Channel => {
                layer.channel = value.parse().map_err(|_| format!("channel '{value}': expected a number from 0"))?;
            }
            Self::Visible => {
                layer.visible = value.parse().map_err(|_| format!("visible '{value}': expected true or false"))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_say_which_layer_and_what() {
        let matrix = volume_setting("1:matrix=1 0 0 0, 0 1 0 0, 0 0 1 0").unwrap();
        assert_eq!((matrix.layer, matrix.key), (1, VolumeKey::Matrix));
        let mut layer = SceneLayer::default();
        for text in [
            "0:isovalue=-300,opacity=0.3",
            "0:isovalue=350,color=1:0:0",
            "0:blend=add",
            "0:opacity=0.25",
            "0:crop=-1:2,0:3,4:5",
            "0:window=-4.5:30",
            "0:color=1:0.5:0",
            "0:gamma=0.5",
            "0:show-labels=3, 7",
            "0:channel=2",
            "0:visible=false",
        ] {
            let VolumeSetting { key, value, .. } = volume_setting(text).unwrap();
            key.set(&mut layer, &value).unwrap();
        }
        assert_eq!((layer.blend, layer.opacity, layer.channel, layer.visible), (Some(Blend::Add), 0.25, 2, false));
        assert_eq!((layer.window, layer.color, layer.gamma), (Some([-4.5, 30.0]), Some([1.0, 0.5, 0.0]), 0.5));
        assert!(layer.crop.is_some() && layer.show_labels == Some(vec![3, 7]));
        assert_eq!(
            layer.isosurfaces.iter().map(|s| (s.value, s.opacity)).collect::<Vec<_>>(),
            [(-300.0, 0.3), (350.0, 1.0)]
        );
        for (bad, word) in [
            ("blend=add", "N:KEY=VALUE"),
            ("x:blend=add", "N:KEY=VALUE"),
            ("0:blend", "N:KEY=VALUE"),
            ("0:bland=add", "expected one of transfer, matrix"),
            ("0:blend=under", "mix, add or over"),
            ("0:opacity=2", "0 to 1"),
            ("0:opacity=nan", "0 to 1"),
            ("0:isovalue=300,opacity=x", "0..1"),
            ("0:isovalue=bone", "VALUE"),
            ("0:crop=3:1,0:1,0:1", "empty"),
            ("0:window=3:3", "LOW:HIGH"),
            ("0:window=3", "LOW:HIGH"),
            ("0:color=1:0", "R,G,B"),
            ("0:gamma=0", "positive"),
            ("0:show-labels=3;7", "whole numbers"),
            ("0:channel=-1", "from 0"),
            ("0:visible=maybe", "true or false"),
        ] {
            let error = volume_setting(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
