//! The plan of a pack in words and as JSON: the volume as it is understood, and the needs of packing it.

use super::values::{human_bytes, short};
use brickyard::import::SourceInfo;
use brickyard::store::PackPlan;
use brickyard::volume::counted;
use serde_json::{Value, json};
use std::time::Duration;

/// A source, the plan of packing it, and an estimate of the time, if there is one.
pub(crate) struct PlanText<'a> {
    pub(crate) info: &'a SourceInfo,
    pub(crate) plan: &'a PackPlan,
    pub(crate) time: Option<Duration>,
}

impl PlanText<'_> {
    /// The plan in one line.
    pub(crate) fn words(&self) -> String {
        let PackPlan { memory_bytes, output_bytes_at_most, files_at_most, .. } = *self.plan;
        let [memory, scratch, output] = [memory_bytes, self.scratch_bytes(), output_bytes_at_most].map(human_bytes);
        let time = self.time.map_or(String::new(), |time| format!("; about {}", in_words(time)));
        let files = counted(files_at_most, "file");
        format!(
            "packing {}: at most {memory} of memory, {scratch} of scratch, {output} of output in {files}{time}",
            self.volume()
        )
    }

    /// The plan as JSON.
    pub(crate) fn json(&self) -> Value {
        let SourceInfo { extent, geometry, calibrated, orientation, voxel_type, .. } = self.info;
        json!({
            "axes": self.plan.layout.axes().concat(),
            "times": self.info.times,
            "time_axis": self.info.time,
            "channels": self.info.channels,
            "channel_looks": self.info.channel_looks,
            "extent": extent.to_array(),
            "voxel_type": voxel_type,
            "spacing": geometry.spacing.to_array(),
            "origin": geometry.origin.to_array(),
            "unit": geometry.unit,
            "axis_units": geometry.axis_units,
            "calibrated": calibrated,
            "orientation": orientation,
            "memory_bytes": self.plan.memory_bytes,
            "scratch_bytes": self.scratch_bytes(),
            "output_bytes_at_most": self.plan.output_bytes_at_most,
            "files_at_most": self.plan.files_at_most,
            "seconds": self.time.map(|time| time.as_secs_f64().round()),
            "notes": self.info.notes.iter().map(|note| &**note).collect::<Vec<_>>(),
        })
    }

    /// The volume, as in `t9 z64 y160 x160 of i16 in HU, spacing 0.65,0.65,2 millimeter, axes to LPS, steps 2 s apart, from 0 s`.
    fn volume(&self) -> String {
        let SourceInfo { extent, times, channels, geometry, .. } = self.info;
        let size = |axis: &str| match axis {
            "t" => *times,
            "c" => *channels,
            "z" => extent.z,
            "y" => extent.y,
            _ => extent.x,
        };
        let shape: Vec<String> = self.plan.layout.axes().iter().map(|axis| format!("{axis}{}", size(axis))).collect();
        let spacing = match self.info.calibrated {
            true => {
                let [x, y, z] = geometry.spacing.to_array().map(short);
                let unit = geometry.units_in_words();
                format!("spacing {x},{y},{z} {}", unit.unwrap_or_else(|| self.without_unit().into()))
            }
            false => "uncalibrated".into(),
        };
        let orientation = self.info.orientation.map_or(String::new(), |it| format!(", axes to {}", it.code()));
        let steps = self.info.time.as_ref().map_or(String::new(), |axis| format!(", steps {}", axis.describe()));
        format!("{} of {}{}, {spacing}{orientation}{steps}", shape.join(" "), self.info.voxel_type, self.value_unit())
    }

    /// The world of a patient is in millimetres, also where its source says no unit.
    fn without_unit(&self) -> &'static str {
        if self.info.orientation.is_some() { "(no unit: taken as millimeter)" } else { "(no unit)" }
    }

    /// The unit of the values, as in ` in HU`; units that differ between channels all, as in ` in K, m/s, no unit`.
    fn value_unit(&self) -> String {
        let looks = &self.info.channel_looks;
        if looks.iter().all(|look| look.unit.is_none()) {
            return String::new();
        }
        let mut units: Vec<&str> = looks.iter().map(|look| look.unit.as_deref().unwrap_or("no unit")).collect();
        units.dedup();
        format!(" in {}", units.join(", "))
    }

    fn scratch_bytes(&self) -> u64 {
        self.plan.scratch_bytes.saturating_add(self.plan.input_scratch_bytes)
    }
}

/// A time in its greatest units: no estimate is better than that.
fn in_words(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    match seconds {
        ..1.5 => "1 s".into(),
        ..90.0 => format!("{seconds:.0} s"),
        ..5400.0 => format!("{:.0} min", seconds / 60.0),
        ..172_800.0 => format!("{:.0} h", seconds / 3600.0),
        _ => format!("{:.0} days", seconds / 86400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::import::{Source, SynthKind, SynthSource};
    use brickyard::store::{PackOptions, plan};
    use brickyard::volume::{Extent, Orientation, TimeAxis, VoxelType};
    use glam::DVec3;

    #[test]
    fn a_plan_says_how_the_input_is_understood() {
        let source = SynthSource::new(SynthKind::Ct, Extent::new(30, 20, 10), VoxelType::U8, 3, 1).unwrap();
        let plan = plan(&source, &PackOptions { threads: 1, ..PackOptions::new(VoxelType::U8) }).unwrap();
        let mut info = source.info().clone();
        info.calibrated = false;
        let text = |info: &SourceInfo, time| PlanText { info, plan: &plan, time }.words();
        let words = text(&info, None);
        assert!(words.starts_with("packing t3 z10 y20 x30 of u8, uncalibrated: at most "), "{words}");
        assert!(words.contains(&format!("of output in {} files", plan.files_at_most)) && !words.contains("about"));
        info.calibrated = true;
        info.geometry.spacing = DVec3::new(0.5, 0.1 + 0.2, 2.0);
        info.geometry.unit = Some("millimeter".into());
        info.time = Some(TimeAxis::default());
        let rows = [[-0.5, 0.0, 0.0, 9.0], [0.0, -0.3, 0.0, 9.0], [0.0, 0.0, 2.0, 9.0]];
        info.orientation = Some(Orientation::new(rows).unwrap());
        let words = text(&info, Some(Duration::from_secs(200)));
        assert!(
            words.contains("spacing 0.5,0.3,2 millimeter, axes to LPS, steps 1 apart, from 0: ")
                && words.ends_with("; about 3 min"),
            "{words}"
        );
        let json = PlanText { info: &info, plan: &plan, time: None }.json();
        assert_eq!(
            (&json["axes"], &json["extent"], &json["seconds"]),
            (&json!("tzyx"), &json!([30, 20, 10]), &Value::Null)
        );
    }

    #[test]
    fn axes_of_unlike_units_are_told() {
        let source = SynthSource::new(SynthKind::Ct, Extent::new(30, 20, 10), VoxelType::U8, 1, 1).unwrap();
        let plan = plan(&source, &PackOptions { threads: 1, ..PackOptions::new(VoxelType::U8) }).unwrap();
        let mut info = source.info().clone();
        info.geometry.take_units(["degree", "degree", "hPa"]);
        let told = PlanText { info: &info, plan: &plan, time: None };
        assert!(told.words().contains(" degree, degree, hPa: at most "), "{}", told.words());
        assert_eq!(told.json()["axis_units"], json!(["degree", "degree", "hPa"]));
    }

    #[test]
    fn times_are_round() {
        let words =
            [0.2, 1.6, 61.0, 100.0, 5000.0, 7300.0, 200_000.0, 400_000.0].map(|s| in_words(Duration::from_secs_f64(s)));
        assert_eq!(words, ["1 s", "2 s", "61 s", "2 min", "83 min", "2 h", "2 days", "5 days"]);
    }
}
