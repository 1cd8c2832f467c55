//! `--volume N:KEY=VALUE`: how one of several stores looks. Values have the form that they have in flags for one store.

use super::values;
use brickyard::volume::{Blend, VolumeLook};

/// One setting of one volume.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct VolumeSetting {
    pub(crate) volume: usize,
    pub(crate) key: VolumeKey,
    pub(crate) value: String,
}

/// What is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum VolumeKey {
    Transfer,
    Matrix,
    Blend,
    Opacity,
    Isovalue,
    Crop,
    Channel,
    Visible,
}

const KEYS: [(&str, VolumeKey); 8] = [
    ("transfer", VolumeKey::Transfer),
    ("matrix", VolumeKey::Matrix),
    ("blend", VolumeKey::Blend),
    ("opacity", VolumeKey::Opacity),
    ("isovalue", VolumeKey::Isovalue),
    ("crop", VolumeKey::Crop),
    ("channel", VolumeKey::Channel),
    ("visible", VolumeKey::Visible),
];

/// `N:KEY=VALUE`.
pub(crate) fn volume_setting(text: &str) -> Result<VolumeSetting, String> {
    let form = || format!("'{text}': expected N:KEY=VALUE, as in 1:blend=add");
    let (volume, rest) = text.split_once(':').ok_or_else(form)?;
    let (key, value) = rest.split_once('=').ok_or_else(form)?;
    let volume = volume.trim().parse().map_err(|_| form())?;
    let names = || KEYS.map(|(name, _)| name).join(", ");
    let found = KEYS.iter().find(|(name, _)| *name == key.trim());
    let (_, key) = found.ok_or_else(|| format!("'{text}': no '{}': expected one of {}", key.trim(), names()))?;
    let setting = VolumeSetting { volume, key: *key, value: value.trim().to_string() };
    // What can be told from the words alone is told at once.
    setting.key.set(&mut VolumeLook::default(), &setting.value).map(|()| setting)
}

impl VolumeKey {
    /// Sets it, or adds an isosurface; a transfer function and a matrix, which need more than the words, are left to others.
    pub(crate) fn set(self, look: &mut VolumeLook, value: &str) -> Result<(), String> {
        match self {
            Self::Transfer | Self::Matrix => {}
            Self::Blend => {
                look.blend = match value {
                    "mix" => Blend::Mix,
                    "add" => Blend::Add,
                    _ => return Err(format!("blend '{value}': expected mix or add")),
                }
            }
            Self::Opacity => {
                let opacity = value.parse::<f64>().ok().filter(|opacity| (0.0..=1.0).contains(opacity));
                look.opacity = opacity.ok_or_else(|| format!("opacity '{value}': expected a number from 0 to 1"))?;
            }
            Self::Isovalue => look.isosurfaces.push(values::isosurface(value)?),
            Self::Crop => look.crop = Some(values::world_box(value)?),
            Self::Channel => {
                let channel = value.parse().map_err(|_| format!("channel '{value}': expected a number from 0"))?;
                look.channel = Some(channel);
            }
            Self::Visible => {
                let visible = value.parse().map_err(|_| format!("visible '{value}': expected true or false"))?;
                look.visible = visible;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_say_which_volume_and_what() {
        let matrix = volume_setting("1:matrix=1 0 0 0, 0 1 0 0, 0 0 1 0").unwrap();
        assert_eq!((matrix.volume, matrix.key), (1, VolumeKey::Matrix));
        let mut look = VolumeLook::default();
        for text in [
            "0:isovalue=-300,opacity=0.3",
            "0:isovalue=350,color=1:0:0",
            "0:blend=add",
            "0:opacity=0.25",
            "0:crop=-1:2,0:3,4:5",
            "0:channel=2",
            "0:visible=false",
        ] {
            let VolumeSetting { key, value, .. } = volume_setting(text).unwrap();
            key.set(&mut look, &value).unwrap();
        }
        assert_eq!((look.blend, look.opacity, look.channel, look.visible), (Blend::Add, 0.25, Some(2), false));
        assert!(look.crop.is_some());
        assert_eq!(
            look.isosurfaces.iter().map(|s| (s.value, s.opacity)).collect::<Vec<_>>(),
            [(-300.0, 0.3), (350.0, 1.0)]
        );
        for (bad, word) in [
            ("blend=add", "N:KEY=VALUE"),
            ("x:blend=add", "N:KEY=VALUE"),
            ("0:blend", "N:KEY=VALUE"),
            ("0:bland=add", "expected one of transfer, matrix"),
            ("0:blend=over", "mix or add"),
            ("0:opacity=2", "0 to 1"),
            ("0:opacity=nan", "0 to 1"),
            ("0:isovalue=300,opacity=x", "0..1"),
            ("0:isovalue=bone", "VALUE"),
            ("0:crop=3:1,0:1,0:1", "empty"),
            ("0:channel=-1", "from 0"),
            ("0:visible=maybe", "true or false"),
        ] {
            let error = volume_setting(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
