//! `brickyard edit`: new metadata for a finished store, without its voxels.

use super::interrupt::Interrupt;
use super::pack_settings::{KINDS, PackingLimits};
use super::progress::Progress;
use super::say::say;
use super::volume_args::placement;
use super::{Failure, channel_args, heading, print_json, print_line, store_errors, values};
use brickyard::import::ChannelChoice;
use brickyard::store::{self, AppendOptions, ChannelEdit, Edit, Kind};
use brickyard::volume::Orientation;
use clap::Args;
use glam::DVec3;
use std::path::PathBuf;

/// `brickyard edit STORE`
#[derive(Args)]
pub(crate) struct EditArguments {
    /// The store
    store: PathBuf,
    /// World distance between voxel centres of level 0 [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "X,Y,Z", value_parser = values::spacing)]
    spacing: Option<DVec3>,
    /// World position of the first voxel's centre [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    origin: Option<DVec3>,
    /// World unit: nm, um, mm, cm, m, or a UDUNITS name; or those of x, y and z, as degree,degree,hPa. Numbers stay as
    /// they are; --spacing and --origin in several units of length are converted to the first one's [default: the
    /// store's]
    #[arg(help_heading = heading::STORE, long, value_name = "UNIT[,UNIT,UNIT]")]
    unit: Option<String>,
    /// Map from voxel indices to the patient's right, front and head, in the unit of the store, as NIfTI's: 12 or 16
    /// numbers row by row, or a file with them; it has spacing and origin, too [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "NUMBERS|FILE", conflicts_with_all = ["spacing", "origin"], allow_hyphen_values = true)]
    matrix: Option<String>,
    /// Unit of the values of all channels, such as HU [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "UNIT")]
    value_unit: Option<String>,
    /// Time from one step to the next, for evenly spaced steps [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "TIME", value_parser = values::positive, allow_negative_numbers = true, conflicts_with = "time_stamps")]
    time_step: Option<f64>,
    /// Unit of time: s, ms, us, ns, min, h, d, or a UDUNITS name [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "UNIT")]
    time_unit: Option<String>,
    /// File with the time of each step, for unevenly spaced steps: one number per line, ascending [default: the
    /// store's]
    #[arg(help_heading = heading::STORE, long, value_name = "FILE")]
    time_stamps: Option<PathBuf>,
    /// Name of the volume in the store's OME-Zarr metadata [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "NAME")]
    name: Option<String>,
    /// Meaning of the voxels; for labels, coarser levels that are means are made again, by mode [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_parser = KINDS)]
    kind: Option<Kind>,
    /// Name of a channel, chosen by number from 0 or by its name so far [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "CHANNEL=NAME", value_parser = channel_name)]
    channel_name: Vec<ChannelEdit>,
    /// Color of a channel, or of all: a name, RRGGBB, or R:G:B in 0..1 [default: the store's]
    #[arg(help_heading = heading::STORE, long, value_name = "[CHANNEL=]COLOR", value_parser = channel_color)]
    channel_color: Vec<ChannelEdit>,
    #[command(flatten)]
    limits: PackingLimits,
    /// Make all checks, print the changes, and change nothing
    #[arg(help_heading = heading::OUTPUT, long)]
    dry_run: bool,
    /// Print the changes as JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
}

/// Reads `CHANNEL=NAME`.
fn channel_name(text: &str) -> Result<ChannelEdit, String> {
    let (channel, name) = text.split_once('=').ok_or("expected CHANNEL=NAME, as in 0=DAPI")?;
    Ok(ChannelEdit { channel: Some(choice(channel)?), name: Some(name.trim().into()), color: None })
}

/// Reads `COLOR` or `CHANNEL=COLOR`. Names may contain equals signs, colours do not.
fn channel_color(text: &str) -> Result<ChannelEdit, String> {
    let (channel, color) = match text.rsplit_once('=') {
        Some((channel, color)) => (Some(choice(channel)?), color),
        None => (None, text),
    };
    let color = channel_args::color(color.trim())?.map(|part| (part * 255.0).round() as u8);
    Ok(ChannelEdit { channel, name: None, color: Some(color) })
}

fn choice(text: &str) -> Result<ChannelChoice, String> {
    text.parse()
}

/// Runs `edit`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: EditArguments) -> Result<(), Failure> {
    let EditArguments { store, dry_run, json, .. } = &arguments;
    let (store, is_dry, json, limits) = (store.clone(), *dry_run, *json, arguments.limits);
    let edit = arguments.edit()?;
    if edit == Edit::default() {
        return Err(Failure::usage("expected a value to set, as in --spacing 0.5,0.5,2 --unit um"));
    }
    let AppendOptions { memory_bytes, threads } = limits.of_append();
    let edited = match is_dry {
        true => store::rehearse_edit(&store, &edit, memory_bytes, threads),
        false => {
            let watcher =
                Watcher { progress: Progress::new(limits.progress, "levels"), interrupt: Interrupt::watch()? };
            let edited = store::edit_within(&store, &edit, memory_bytes, threads, &watcher);
            watcher.progress.finish();
            edited
        }
    };
    let report = edited.map_err(store_errors::edit_failure)?;
    if json {
        let change = |change: &store::EditChange| {
            let store::EditChange { field, old, new } = change;
            serde_json::json!({ "field": field, "old": old, "new": new })
        };
        let changes: Vec<_> = report.changes.iter().map(change).collect();
        print_json(&serde_json::json!({ "store": store, "dry_run": is_dry, "changes": changes }))?;
    } else {
        report.changes.iter().try_for_each(|change| print_line(&change.to_string()))?;
    }
    for group in &report.stale_groups {
        let what = "holds a copy of this store's metadata with the former values: consolidate it anew";
        say!("warning: {}: {what} (zarr.consolidate_metadata)", group.display());
    }
    if is_dry {
        say!("note: {} is unchanged (--dry-run)", store.display());
    }
    Ok(())
}

/// Shows the progress of making levels.
struct Watcher {
    progress: Progress,
    interrupt: Interrupt,
}

impl store::Progress for Watcher {
    fn advanced(&self, done: u64, total: u64) {
        self.progress.set(done, total);
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.is_asked()
    }
}

impl EditArguments {
    fn edit(self) -> Result<Edit, Failure> {
        let orientation = |value: String| {
            let flag = format!("--matrix {value}");
            let rows = placement(&value, &flag)?.rows();
            Orientation::new(rows).map_err(|error| Failure::usage(format!("{flag}: {error}")))
        };
        Ok(Edit {
            spacing: self.spacing,
            origin: self.origin,
            unit: self.unit,
            orientation: self.matrix.map(orientation).transpose()?,
            value_unit: self.value_unit,
            time_step: self.time_step,
            time_unit: self.time_unit,
            time_stamps: self.time_stamps,
            name: self.name,
            kind: self.kind,
            channels: [self.channel_name, self.channel_color].concat(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_named_and_coloured_by_number_or_name() {
        let name = channel_name("0=a=b").unwrap();
        assert_eq!((name.channel, name.name.as_deref()), ("0".parse().ok(), Some("a=b")));
        assert!(channel_name("DAPI").unwrap_err().contains("CHANNEL=NAME") && channel_name("=x").is_err());
        let color = channel_color("p=q=1:0.5:0").unwrap();
        assert_eq!((color.channel, color.color), ("p=q".parse().ok(), Some([255, 128, 0])));
        assert_eq!(
            channel_color("00ff7F").unwrap(),
            ChannelEdit { color: Some([0, 255, 127]), ..ChannelEdit::default() }
        );
        assert!(channel_color("1=gren").unwrap_err().contains("green"));
    }
}
