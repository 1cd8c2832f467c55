//! The elements and sequences of which a volume needs the values.

use dicom_core::Tag;
use dicom_dictionary_std::tags;

/// Elements kept from a data set.
pub(super) const WANTED: &[Tag] = &[
    tags::IMAGE_TYPE,
    tags::FRAME_TYPE,
    tags::COMPLEX_IMAGE_COMPONENT,
    tags::SOP_CLASS_UID,
    tags::SOP_INSTANCE_UID,
    tags::MODALITY,
    tags::SERIES_DESCRIPTION,
    tags::SERIES_INSTANCE_UID,
    tags::SERIES_NUMBER,
    tags::STACK_ID,
    tags::INSTANCE_NUMBER,
    tags::ACQUISITION_NUMBER,
    tags::ACQUISITION_DATE,
    tags::ACQUISITION_TIME,
    tags::ACQUISITION_DATE_TIME,
    tags::FRAME_ACQUISITION_DATE_TIME,
    tags::CONTENT_DATE,
    tags::CONTENT_TIME,
    tags::TEMPORAL_POSITION_IDENTIFIER,
    tags::TEMPORAL_POSITION_INDEX,
    tags::TEMPORAL_POSITION_TIME_OFFSET,
    tags::TRIGGER_TIME,
    tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME,
    tags::NOMINAL_PERCENTAGE_OF_CARDIAC_PHASE,
    tags::FRAME_REFERENCE_TIME,
    tags::ECHO_TIME,
    tags::EFFECTIVE_ECHO_TIME,
    tags::ECHO_NUMBERS,
    tags::INVERSION_TIME,
    tags::INVERSION_TIMES,
    tags::FLIP_ANGLE,
    tags::KVP,
    tags::DIFFUSION_B_VALUE,
    tags::DIFFUSION_GRADIENT_ORIENTATION,
    tags::DIMENSION_INDEX_VALUES,
    tags::SEGMENTATION_TYPE,
    tags::MAXIMUM_FRACTIONAL_VALUE,
    tags::REFERENCED_SEGMENT_NUMBER,
    tags::IMAGE_POSITION_PATIENT,
    tags::IMAGE_ORIENTATION_PATIENT,
    tags::SPACING_BETWEEN_SLICES,
    tags::SLICE_THICKNESS,
    tags::SAMPLES_PER_PIXEL,
    tags::PHOTOMETRIC_INTERPRETATION,
    tags::NUMBER_OF_FRAMES,
    tags::ROWS,
    tags::COLUMNS,
    tags::PIXEL_SPACING,
    tags::BITS_ALLOCATED,
    tags::BITS_STORED,
    tags::HIGH_BIT,
    tags::PIXEL_REPRESENTATION,
    tags::PIXEL_PADDING_VALUE,
    tags::PIXEL_PADDING_RANGE_LIMIT,
    tags::RESCALE_INTERCEPT,
    tags::RESCALE_SLOPE,
    tags::RESCALE_TYPE,
    tags::UNITS,
    tags::MODALITY,
    tags::WINDOW_CENTER,
    tags::WINDOW_WIDTH,
];

/// Sequences within a functional group that hold a frame's elements.
pub(super) const MACROS: &[Tag] = &[
    tags::PLANE_POSITION_SEQUENCE,
    tags::PLANE_ORIENTATION_SEQUENCE,
    tags::PIXEL_MEASURES_SEQUENCE,
    tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE,
    tags::FRAME_VOILUT_SEQUENCE,
    tags::FRAME_CONTENT_SEQUENCE,
    tags::TEMPORAL_POSITION_SEQUENCE,
    tags::CARDIAC_SYNCHRONIZATION_SEQUENCE,
    tags::MR_IMAGE_FRAME_TYPE_SEQUENCE,
    tags::CT_IMAGE_FRAME_TYPE_SEQUENCE,
    tags::MR_ECHO_SEQUENCE,
    tags::MR_DIFFUSION_SEQUENCE,
    tags::MR_TIMING_AND_RELATED_PARAMETERS_SEQUENCE,
    tags::MR_MODIFIER_SEQUENCE,
    tags::SEGMENT_IDENTIFICATION_SEQUENCE,
];

/// Those without which frames have no place, scale or segment.
pub(super) const NEEDED: [Tag; 6] = [
    tags::PLANE_POSITION_SEQUENCE,
    tags::PLANE_ORIENTATION_SEQUENCE,
    tags::PIXEL_MEASURES_SEQUENCE,
    tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE,
    tags::FRAME_VOILUT_SEQUENCE,
    tags::SEGMENT_IDENTIFICATION_SEQUENCE,
];

/// Elements kept from each item of these sequences, outside of functional groups.
pub(super) const LISTS: &[(Tag, &[Tag])] = &[
    (tags::DIMENSION_INDEX_SEQUENCE, &[tags::DIMENSION_INDEX_POINTER]),
    (tags::SEGMENT_SEQUENCE, &[tags::SEGMENT_NUMBER, tags::SEGMENT_LABEL]),
];
