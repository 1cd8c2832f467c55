//! Plane-to-page map from OME's `TiffData` elements: in any order, from several files. Every plane must have one page.

use super::arrange::too_few_or_many;
use super::ome::{Pixels, TiffData};
use crate::axes::Sizes;
use crate::page_map::{LISTED, PageMap, PageOrder, Place};

/// The files with the mapped pages.
pub(super) struct Files<'a> {
    /// Number of pages of each file.
    pub(super) pages: &'a [u32],
    /// Names of the files, for messages.
    pub(super) names: &'a [String],
    /// The file of each of [`Pixels::parts`].
    pub(super) of_part: &'a [u32],
    /// The file with the XML, if it has pages.
    pub(super) own: Option<u32>,
}

const UNSET: Place = Place { file: u32::MAX, page: u32::MAX };

/// Maps the planes of `pixels` to pages: as a list, or an equivalent rule. The list takes eight bytes a page. `sizes` are in pages.
///
/// # Errors
/// If a plane has no page or two, or a page or plane does not exist. The message names it.
pub(super) fn map(pixels: &Pixels, sizes: Sizes, files: &Files) -> Result<PageMap, String> {
    let channels = sizes.channels;
    let samples = pixels.sizes[1] / channels;
    let (planes, pages) = (sizes.planes(), files.pages.iter().map(|&n| n as u64).sum::<u64>());
    if planes > pages {
        return Err(too_few_or_many(sizes, pages, if files.pages.len() == 1 { "it holds" } else { "its files hold" }));
    }
    // Some programs count the samples of a pixel as channels here, too.
    let counts_samples = pixels.tiff_data.iter().any(|data| data.first[1] >= channels);
    let mut mapping = Mapping { pixels, sizes, files, places: vec![UNSET; planes as usize] };
    for data in &pixels.tiff_data {
        let mut first = data.first;
        if counts_samples {
            first[1] /= samples;
        }
        mapping.take(TiffData { first, ..*data })?;
    }
    let places = mapping.places;
    if let Some(missing) = places.iter().position(|&place| place == UNSET) {
        let plane = Plane(sizes.plane_of(missing as u64, &LISTED));
        return Err(format!(
            "its OME-XML (TiffData) gives no page for {plane}; pass `axes` zyx to take the pages as they are"
        ));
    }
    let map = PageMap { sizes, order: PageOrder::Listed(places) };
    Ok(if files.pages.len() == 1 { map.shortened(&pixels.axes) } else { map })
}

struct Mapping<'a> {
    pixels: &'a Pixels,
    sizes: Sizes,
    files: &'a Files<'a>,
    places: Vec<Place>,
}

impl Mapping<'_> {
    /// Adds the places given by one element.
    fn take(&mut self, data: TiffData) -> Result<(), String> {
        let file = match data.part {
            Some(part) => self.files.of_part[part as usize],
            None => self.files.own.ok_or("its OME-XML has TiffData without a file name (UUID FileName)")?,
        };
        let pages = self.files.pages[file as usize];
        let limits = [self.sizes.times, self.sizes.channels, self.sizes.extent.z];
        let plane = Plane(data.first);
        if data.first.iter().zip(limits).any(|(&i, limit)| i >= limit) {
            return Err(format!("its OME-XML (TiffData) names {plane}, which is outside of its sizes"));
        }
        let ifd = data.ifd.unwrap_or(0);
        let count = data.count.unwrap_or(if data.ifd.is_some() { 1 } else { pages });
        let start = self.sizes.number_of(data.first, &self.pixels.axes);
        for i in 0..count {
            let page = ifd.checked_add(i).filter(|&page| page < pages).ok_or_else(|| {
                format!(
                    "its OME-XML (TiffData) names directory {} of {}, which has {pages} (0 to {}); fetch the file \
                     again",
                    ifd as u64 + i as u64,
                    self.files.names[file as usize],
                    pages.saturating_sub(1)
                )
            })?;
            let index = start + i as u64;
            if index >= self.places.len() as u64 {
                return Err(too_few_or_many(self.sizes, start + count as u64, "its TiffData elements name"));
            }
            let plane = Plane(self.sizes.plane_of(index, &self.pixels.axes));
            let place = &mut self.places[self.sizes.number_of(plane.0, &LISTED) as usize];
            if *place != UNSET {
                let names = [*place, Place { file, page }]
                    .map(|place| format!("directory {} of {}", place.page, self.files.names[place.file as usize]));
                return Err(format!(
                    "its OME-XML (TiffData) gives two pages for {plane}: {} and {}; pass `axes` zyx to take the pages as they are",
                    names[0], names[1]
                ));
            }
            *place = Place { file, page };
        }
        Ok(())
    }
}

/// A plane's step, channel and slice, as named in messages.
struct Plane([u32; 3]);

impl std::fmt::Display for Plane {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self([t, c, z]) = self;
        write!(f, "the plane of step {t}, channel {c}, slice {z}")
    }
}
