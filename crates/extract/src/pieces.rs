//! The pieces of an object that is being decimated: kept in a nameless file until all blocks are in, then joined, decimated once more and written.
//!
//! Vertices that several pieces have get their numbers from a table on disk, by id; the last pages of it are kept. Costs 192 bytes of memory for each
//! part of a block's surface: up to eight of a block, for each label beyond it.

use crate::decimation::{Decimation, MOST_WEIGHT, Region, runs};
use crate::error::MeshError;
use crate::format::Place;
use crate::number_table::NumberTable;
use crate::piece::{Counts, Piece};
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::os::unix::fs::FileExt;

/// A piece in the file.
#[derive(Clone, Copy, Debug)]
struct Entry {
    region: Region,
    offset: u64,
    counts: Counts,
}

/// Bytes of memory of a piece in the list, which grows by doubling and is sorted with its weights.
const ENTRY_BYTES: u64 = 4 * size_of::<Entry>() as u64;

/// Pieces on disk.
pub(crate) struct Pieces {
    decimation: Decimation,
    place: Place,
    file: BufWriter<File>,
    bytes: u64,
    entries: Vec<Entry>,
    most_entries: u64,
    numbers: NumberTable,
}

impl Pieces {
    /// No pieces yet, in files beside the output, and a list of at most `list_bytes`.
    ///
    /// # Errors
    /// If the system refuses the files.
    pub(crate) fn begin(place: Place, decimation: Decimation, list_bytes: u64) -> Result<Self, MeshError> {
        let file = place.scratch()?.file;
        let numbers = place.scratch()?.file.into_inner().map_err(|error| place.io(error.into_error()))?;
        let (most_entries, numbers) = (list_bytes / ENTRY_BYTES, NumberTable::new(numbers));
        Ok(Self { decimation, place, file, bytes: 0, entries: Vec::new(), most_entries, numbers })
    }

    /// Adds a piece, whose ids are those of the whole object.
    ///
    /// # Errors
    /// If the file cannot be written, or the list outgrows its memory.
    pub(crate) fn add(&mut self, region: Region, piece: &Piece) -> Result<(), MeshError> {
        if self.entries.len() as u64 >= self.most_entries {
            let problem = "`memory` is too little for the list of pieces of so large a mesh; allow more, or take a coarser level or a box";
            return Err(MeshError::Unfit(problem.into()));
        }
        let (counts, bytes) = (piece.counts(), piece.encode());
        self.file.write_all(&bytes).map_err(|error| self.place.io(error))?;
        self.entries.push(Entry { region, offset: self.bytes, counts });
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Decimates and hands over all pieces, in an order of their own, then forgets them. `write` gets each piece with the numbers of its vertices, and
    /// `None` where the vertex is new and takes the next one.
    ///
    /// # Errors
    /// If a file fails, or `write` does.
    pub(crate) fn drain(
        &mut self,
        mut write: impl FnMut(&Piece, &[Numbered]) -> Result<(), MeshError>,
    ) -> Result<(), MeshError> {
        let mut entries = std::mem::take(&mut self.entries);
        // Stable: pieces of a region stay in the order of their blocks.
        entries.sort_by_key(|entry| entry.region);
        let parts: Vec<(Region, u64)> = entries.iter().map(|entry| (entry.region, entry.counts.weight())).collect();
        let mut rest = &entries[..];
        let mut regions = Vec::new();
        for length in runs(&parts) {
            let (region, others) = rest.split_at(length);
            regions.push(region);
            rest = others;
        }
        drop(parts);
        self.file.flush().map_err(|error| self.place.io(error))?;
        let mut next = 0;
        let mut regions = &regions[..];
        while !regions.is_empty() {
            // Regions which together weigh no more than one of the greatest for each thread.
            let most = rayon::current_num_threads() as u64 * MOST_WEIGHT;
            let sums = regions.iter().scan(0, |sum, region| {
                *sum += region.iter().map(|entry| entry.counts.weight()).sum::<u64>();
                Some(*sum)
            });
            let (some, others) = regions.split_at(sums.take_while(|sum| *sum <= most).count().max(1));
            regions = others;
            let decimated = |region: &&[Entry]| self.read(region).map(|pieces| self.decimation.of_region(&pieces));
            for piece in some.par_iter().with_max_len(1).map(decimated).collect::<Result<Vec<_>, _>>()? {
                let numbers = self.number(&piece, &mut next)?;
                write(&piece, &numbers)?;
            }
        }
        self.numbers.clear().map_err(|error| self.place.io(error))?;
        self.bytes = 0;
        self.file.rewind().and_then(|()| self.file.get_ref().set_len(0)).map_err(|error| self.place.io(error))
    }

    fn read(&self, region: &[Entry]) -> Result<Vec<Piece>, MeshError> {
        let read = |entry: &Entry| {
            let mut bytes = vec![0; entry.counts.bytes()];
            self.file.get_ref().read_exact_at(&mut bytes, entry.offset)?;
            Ok(Piece::decode(&bytes, entry.counts))
        };
        let pieces: std::io::Result<Vec<Piece>> = region.iter().map(read).collect();
        pieces.map_err(|error| self.place.io(error))
    }

    fn number(&mut self, piece: &Piece, next: &mut u64) -> Result<Vec<Numbered>, MeshError> {
        let mut numbered = Vec::with_capacity(piece.ids.len());
        for (id, is_fixed) in piece.ids.iter().zip(&piece.is_fixed) {
            let known = if *is_fixed { self.numbers.get(*id) } else { Ok(None) };
            let known = known.map_err(|error| self.place.io(error))?;
            let number = known.unwrap_or(*next);
            if known.is_none() {
                *next += 1;
                if *is_fixed {
                    self.numbers.set(*id, number).map_err(|error| self.place.io(error))?;
                }
            }
            numbered.push(Numbered { number, is_new: known.is_none() });
        }
        Ok(numbered)
    }
}

/// A vertex's number in its object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Numbered {
    pub(crate) number: u64,
    /// Whether no piece before has it.
    pub(crate) is_new: bool,
}
