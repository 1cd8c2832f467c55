//! Reconstructed volumes of nuclear medicine (SPECT): one place, that of the detector, for all frames, which lie along the normal by their numbers
//! in SliceVector, at the distance of SpacingBetweenSlices, whose sign is the direction (PS3.3 C.8.4.15).

use super::header::Header;
use crate::error::{ImportError, Result};
use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;

/// Numbers of each frame in other respects than its slice, which must be the same for all.
const OTHERS: &[(Tag, &str)] = &[
    (tags::ENERGY_WINDOW_VECTOR, "EnergyWindowVector"),
    (tags::DETECTOR_VECTOR, "DetectorVector"),
    (tags::PHASE_VECTOR, "PhaseVector"),
    (tags::ROTATION_VECTOR, "RotationVector"),
    (tags::RR_INTERVAL_VECTOR, "RRIntervalVector"),
    (tags::TIME_SLOT_VECTOR, "TimeSlotVector"),
    (tags::ANGULAR_VIEW_VECTOR, "AngularViewVector"),
    (tags::TIME_SLICE_VECTOR, "TimeSliceVector"),
];

/// Whether a file is an image of nuclear medicine whose frames have no places of their own.
pub(super) fn is_nuclear(header: &Header) -> bool {
    let is_of_class = header.text(tags::SOP_CLASS_UID).is_some_and(|uid| uid == uids::NUCLEAR_MEDICINE_IMAGE_STORAGE);
    is_of_class && header.placed_frames() == 0
}

/// Checks that all frames of such an image are slices of one volume.
///
/// # Errors
/// If they are projections, times or others, named in the error.
pub(super) fn check(header: &Header, count: u64) -> Result<()> {
    let refuse = |what: &str| {
        let feature = format!("a nuclear medicine image of {count} frames, {what},");
        let advice = "reconstruct it, or export its frames to TIFF or .npy, and pack these with `spacing`";
        Err(ImportError::unsupported_but(&header.path, feature, advice))
    };
    let kinds = header.text(tags::IMAGE_TYPE).unwrap_or_default();
    let kind = kinds.split('\\').nth(2).unwrap_or_default().trim();
    if kind != "RECON TOMO" {
        return refuse(&format!("whose ImageType is '{kind}': only those of RECON TOMO are slices"));
    }
    let numbers = |tag| header.numbers(0, tag).unwrap_or_default();
    if let Some((_, name)) = OTHERS.iter().find(|(tag, _)| numbers(*tag).windows(2).any(|pair| pair[0] != pair[1])) {
        return refuse(&format!("which differ in {name}"));
    }
    let slices = numbers(tags::SLICE_VECTOR);
    if slices.len() as u64 != count {
        return refuse(&format!("of which {} have a number in SliceVector", slices.len()));
    }
    if slices.iter().any(|number| *number < 1.0 || number.fract() != 0.0) {
        return refuse("whose numbers in SliceVector are none from 1 on");
    }
    Ok(())
}

/// Position of a frame, of which the first slice is at `first`.
///
/// # Errors
/// If the distance of slices is missing.
pub(super) fn position(header: &Header, frame: usize, first: DVec3, normal: DVec3) -> Result<DVec3> {
    if !is_nuclear(header) || header.number(tags::NUMBER_OF_FRAMES).is_none_or(|count| count <= 1.0) {
        return Ok(first);
    }
    let step_mm = header.number(tags::SPACING_BETWEEN_SLICES).filter(|mm| *mm != 0.0).ok_or_else(|| {
        let problem =
            "SpacingBetweenSlices is missing or 0: the places of its slices are not known; write the file again";
        ImportError::invalid(&header.path, problem)
    })?;
    let slices = header.numbers(0, tags::SLICE_VECTOR).unwrap_or_default();
    let number = slices.get(frame).copied().unwrap_or(1.0);
    Ok(first + normal * (number - 1.0) * step_mm)
}
