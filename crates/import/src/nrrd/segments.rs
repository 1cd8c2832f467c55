//! Segments of 3D Slicer in the keys of a header: whether voxels are labels, and a note of names, as a store keeps the numbers alone. Costs the keys'
//! text.

use crate::labels::SaidKind;
use crate::note::Note;
use brickyard_volume::VoxelType;
use std::collections::BTreeMap;

/// Most segments named in the note, and the longest name.
const MOST_NAMED: usize = 20;
const LONGEST_NAME: usize = 64;

#[derive(Default)]
struct Segment {
    name: String,
    /// Its voxels' number; `None` in files of early versions, where each segment has ones in a layer of its own.
    value: Option<String>,
    layer: Option<u32>,
}

/// The segments of `Segment0_Name`, `Segment0_LabelValue`, `Segment0_Layer` and so on, by number.
#[derive(Default)]
pub(super) struct Segments {
    by_number: BTreeMap<u32, Segment>,
    representation: Option<String>,
}

impl Segments {
    /// Takes a key and its value, if they are about a segment.
    pub(super) fn add(&mut self, key: &str, value: &str) {
        // The older name is the first.
        if ["Segmentation_MasterRepresentation", "Segmentation_SourceRepresentation"].contains(&key) {
            self.representation = Some(value.to_lowercase());
        }
        let parts = key.strip_prefix("Segment").and_then(|rest| rest.split_once('_'));
        let Some((number, field)) = parts.and_then(|(number, field)| Some((number.parse().ok()?, field))) else {
            return;
        };
        let value: String = value.chars().take(LONGEST_NAME).collect();
        let segment = self.by_number.entry(number).or_default();
        match field {
            "Name" => segment.name = value,
            "LabelValue" => segment.value = Some(value),
            "Layer" => segment.layer = value.parse().ok(),
            _ => {}
        }
    }

    /// The kind of voxels of this type: labels are whole numbers.
    pub(super) fn kind(&self, voxel_type: VoxelType) -> SaidKind {
        match self.are_labels() {
            true if !voxel_type.is_float() => SaidKind::Labels("the header's segments (3D Slicer)"),
            _ => SaidKind::Unsaid,
        }
    }

    /// Whether the voxels are labels: fractions of segments and closed surfaces are none.
    fn are_labels(&self) -> bool {
        // All may be background.
        let is_told = |of: &str| of == "binary labelmap";
        self.representation.as_deref().map_or(!self.by_number.is_empty(), is_told)
    }

    /// Numbers and names of labels, with their channels where there are several.
    pub(super) fn note(&self, channels: u32) -> Option<Note> {
        let described = |(number, segment): (&u32, &Segment)| {
            let Segment { name, value, layer } = segment;
            let channel = format!(" in channel {}", layer.unwrap_or(*number));
            let channel = if channels > 1 { &*channel } else { "" };
            format!("{} {name}{channel}", value.as_deref().unwrap_or("1"))
        };
        let mut list: Vec<String> = self.by_number.iter().take(MOST_NAMED).map(described).collect();
        if self.by_number.len() > MOST_NAMED {
            list.push(format!("and {} more", self.by_number.len() - MOST_NAMED));
        }
        let list = list.join(", ");
        (self.are_labels() && !list.is_empty()).then(|| {
            Note::new(format!("Voxels are labels, the numbers of segments, which the store does not name: {list}."))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Segments;

    #[test]
    fn segments_have_numbers_and_channels() {
        let mut segments = Segments::default();
        let keys = [
            ("Segmentation_MasterRepresentation", "Binary labelmap"),
            ("Segment0_Name", "liver"),
            ("Segment0_LabelValue", "3"),
            ("Segment0_Layer", "0"),
            ("Segment1_Name", "spleen"),
            ("Segment1_Color", "1 0 0"),
            ("Segmentx_Name", "none"),
        ];
        keys.iter().for_each(|(key, value)| segments.add(key, value));
        let said = |channels: u32| segments.note(channels).map(|note| note.to_string()).unwrap_or_default();
        assert!(said(1).ends_with(": 3 liver, 1 spleen."), "{}", said(1));
        assert!(said(2).ends_with(": 3 liver in channel 0, 1 spleen in channel 1."), "{}", said(2));
        let mut none = Segments::default();
        none.add("Segmentation_SourceRepresentation", "Binary labelmap");
        assert_eq!((none.are_labels(), none.note(1)), (true, None));
        segments.add("Segmentation_MasterRepresentation", "Fractional labelmap");
        assert_eq!((segments.are_labels(), segments.note(1)), (false, None));
        assert_eq!(Segments::default().note(1), None);
    }
}
