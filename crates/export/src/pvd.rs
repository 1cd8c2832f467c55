//! ParaView's collection, `.pvd`: a text with the time of each step, and beside it a folder of the same name with a `.vti` file for each. The files are
//! written one after another, and the text comes last. Costs the text: some hundred bytes a step.

use crate::error::ExportError;
use crate::facts::Fact;
use crate::flat;
use crate::job::Job;
use crate::plan::{Body, Plan};
use crate::volume::Volume;
use crate::vti;
use crate::xml::escaped;
use std::fmt::Write;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Most steps: each has a line and a file.
const MOST_STEPS: u32 = 1 << 20;
/// Fewest digits of a file's number: enough for most series.
const DIGITS: usize = 4;

/// The folder of a collection's files.
pub(crate) fn folder_beside(collection: &Path) -> PathBuf {
    collection.with_extension("")
}

/// Whether a name may be one of the files in a collection's folder.
pub(crate) fn is_step_of(folder: &Path, name: &str) -> bool {
    let stem = folder.file_name().unwrap_or_default().to_string_lossy();
    let number = name.strip_prefix(&*stem).and_then(|rest| rest.strip_prefix('_')?.strip_suffix(".vti"));
    number.is_some_and(|number| number.len() >= DIGITS && number.bytes().all(|digit| digit.is_ascii_digit()))
}

pub(crate) fn plan(volume: &Volume) -> Result<Plan, ExportError> {
    vti::check(volume)?;
    let info = volume.info;
    let unfit = |problem: String| ExportError::unfit(volume.output, problem);
    if info.times > MOST_STEPS {
        let problem = format!("a .pvd file holds {MOST_STEPS} time steps at most, not {}: choose fewer", info.times);
        return Err(unfit(problem));
    }
    let folder = folder_beside(volume.output);
    let stem = stem_of(&folder).ok_or_else(|| {
        unfit("its name stands in the text, as XML has it: choose one of letters, digits and blanks".into())
    })?;
    let time = |step: u32| info.time.as_ref().map_or(f64::from(step), |axis| axis.at(step));
    if let Some(step) = (1..info.times).find(|step| time(*step) <= time(step - 1)) {
        let problem = format!("steps {} and {step} are at one time in 64 bits: choose .nrrd or .raw", step - 1);
        return Err(unfit(problem));
    }
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>\n",
    );
    for step in 0..info.times {
        let file = escaped(&format!("{stem}/{}", name_of(stem, info.times, step)));
        let line = format!("    <DataSet timestep=\"{}\" part=\"0\" file=\"{file}\"/>", time(step));
        writeln!(text, "{line}").expect("a string takes all");
    }
    text += "  </Collection>\n</VTKFile>\n";
    let kept = [vti::kept(volume), vec![Fact::Times]].concat();
    let counted = (info.time.is_none() && info.times > 1)
        .then(|| "A .pvd file has a time for each step, and these have none: they are numbered from 0.".to_owned());
    let plan = Plan::new(volume, "A .pvd file", &kept, Body::Series).noted(vti::contradiction(volume)).noted(counted);
    Ok(Plan { text: Some(text.into_bytes()), ..plan })
}

/// The name of files and folder; `None` if it cannot stand in an attribute, as a path of any system.
fn stem_of(folder: &Path) -> Option<&str> {
    let stem = folder.file_name()?.to_str()?;
    let is_plain = |letter: char| !letter.is_control() && !['\\', '\u{fffe}', '\u{ffff}'].contains(&letter);
    stem.chars().all(is_plain).then_some(stem)
}

/// The file of a step, of so many.
fn name_of(stem: &str, times: u32, step: u32) -> String {
    let digits = (times - 1).to_string().len().max(DIGITS);
    format!("{stem}_{step:0digits$}.vti")
}

/// Writes the files of all steps into a folder.
///
/// # Errors
/// If the memory is too little, a block cannot be read, a file cannot be written, or the export is cancelled.
pub(crate) fn write(job: &Job, volume: &Volume, folder: &Path) -> Result<(), ExportError> {
    let io = ExportError::io(job.output);
    let named = folder_beside(volume.output);
    let stem = named.file_name().unwrap_or_default().to_string_lossy();
    for step in 0..volume.info.times {
        let file = File::create_new(folder.join(name_of(&stem, volume.info.times, step))).map_err(&io)?;
        flat::write(job, &vti::layout(volume, step), step..step + 1, &file)?;
        file.sync_all().map_err(&io)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{info, volume};
    use brickyard_import::SourceInfo;
    use brickyard_volume::TimeAxis;

    fn text_of(info: &SourceInfo, output: &str) -> Result<String, String> {
        let volume = Volume { output: Path::new(output), ..volume(info) };
        let text = plan(&volume).map_err(|error| error.to_string())?.text;
        Ok(String::from_utf8(text.unwrap()).unwrap())
    }

    #[test]
    fn files_and_times_are_listed() {
        let time = TimeAxis::of_stamps(vec![-1.5, 0.1, 1e7], None).unwrap();
        let info = SourceInfo { times: 3, time: Some(time), ..info() };
        assert_eq!(
            text_of(&info, "out/a & b.pvd").unwrap(),
            "<?xml version=\"1.0\"?>\n\
             <VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>\n    \
             <DataSet timestep=\"-1.5\" part=\"0\" file=\"a &amp; b/a &amp; b_0000.vti\"/>\n    \
             <DataSet timestep=\"0.1\" part=\"0\" file=\"a &amp; b/a &amp; b_0001.vti\"/>\n    \
             <DataSet timestep=\"10000000\" part=\"0\" file=\"a &amp; b/a &amp; b_0002.vti\"/>\n  \
             </Collection>\n</VTKFile>\n"
        );
    }

    #[test]
    fn names_and_times_that_no_reader_could_tell_apart_are_refused() {
        let three = SourceInfo { times: 3, ..info() };
        for name in ["a\\b.pvd", "a\nb.pvd", "...pvd"] {
            assert!(text_of(&three, name).unwrap_err().contains("choose one of letters"), "{name:?}");
        }
        let close = TimeAxis { start: 1e17, ..TimeAxis::default() };
        let message = text_of(&SourceInfo { time: Some(close), ..three.clone() }, "a.pvd").unwrap_err();
        assert!(message.contains("steps 0 and 1 are at one time"), "{message}");
        let many = SourceInfo { times: MOST_STEPS + 1, ..three };
        assert!(text_of(&many, "a.pvd").unwrap_err().contains("1048576 time steps at most"));
    }

    #[test]
    fn files_of_a_folder_are_known_by_their_names() {
        let folder = Path::new("out/a.b");
        for (name, is_step) in [
            ("a.b_0000.vti", true),
            ("a.b_1048575.vti", true),
            ("a.b_000.vti", false),
            ("a.b_0000.vtu", false),
            ("a.b_00x0.vti", false),
            ("a_0000.vti", false),
            ("a.b_.vti", false),
        ] {
            assert_eq!(is_step_of(folder, name), is_step, "{name}");
        }
    }
}
