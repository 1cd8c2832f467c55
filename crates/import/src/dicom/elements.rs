//! Elements of a data set in order, by the parser, with the sequences around them: short of the pixels, and of nothing past the file's end. Costs
//! what is passed on the way.

use crate::error::{ImportError, Result};
use dicom_core::header::DataElementHeader;
use dicom_core::{PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_parser::dataset::LazyDataToken;
use dicom_parser::dataset::lazy_read::LazyDataSetReader;
use dicom_parser::{DynStatefulDecoder, StatefulDecode};
use dicom_transfer_syntax_registry::{TransferSyntax, TransferSyntaxIndex, TransferSyntaxRegistry};
use std::cell::Cell;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;
use std::rc::Rc;

/// Tags of sequence items.
pub(super) const ITEM: Tag = Tag(0xfffe, 0xe000);
const ITEM_END: Tag = Tag(0xfffe, 0xe00d);
const SEQUENCE_END: Tag = Tag(0xfffe, 0xe0dd);
/// Length of values that end at a mark.
const UNDEFINED: u32 = u32::MAX;
/// Deepest nesting of sequences; images have less.
const DEEPEST: usize = 64;

/// Next part of a data set, with its enclosing sequences, outermost first.
pub(super) enum Element<'a> {
    /// A value, to be read or skipped next.
    Value(&'a [Tag], DataElementHeader),
    /// Start of a sequence, or (with the tag of an item) of one of its items.
    Sequence(&'a [Tag], Tag),
    /// Pixels, whose value begins at [`Elements::into_position`]: their representation, and their length in bytes unless they are encapsulated.
    Pixels { tag: Tag, vr: VR, length: Option<u64> },
}

type Decoder<'a> = DynStatefulDecoder<Tracked<'a>>;

/// A reader that exposes its position, which the parser hides, and tells lengths in place of undefined ones.
struct Tracked<'a> {
    cursor: Cursor<&'a [u8]>,
    shared: Rc<Shared>,
}

/// State of the parser's reader.
struct Shared {
    position: Cell<u64>,
    /// First byte of a length, and its replacement.
    length: Cell<Option<(u64, [u8; 4])>>,
}

impl Read for Tracked<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let start = self.cursor.position();
        let read = self.cursor.read(buffer)?;
        if let Some((at, length)) = self.shared.length.get() {
            for (place, byte) in (at..).zip(length) {
                let place = place.checked_sub(start).filter(|place| *place < read as u64);
                place.into_iter().for_each(|place| buffer[place as usize] = byte);
            }
        }
        self.shared.position.set(self.cursor.position());
        Ok(read)
    }
}

impl Seek for Tracked<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let position = self.cursor.seek(to)?;
        self.shared.position.set(position);
        Ok(position)
    }
}

/// Elements of a data set in order.
pub(super) struct Elements<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    syntax: &'a TransferSyntax,
    reader: LazyDataSetReader<Decoder<'a>>,
    shared: Rc<Shared>,
    /// End of the last value read or skipped.
    pub(super) position: usize,
    sequences: Vec<Tag>,
    /// Number of open items: as many as sequences, or one less.
    items: usize,
}

impl<'a> Elements<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], start: usize, syntax: &str) -> Result<Self> {
        let syntax = TransferSyntaxRegistry
            .get(syntax)
            .ok_or_else(|| ImportError::unsupported(path, format!("transfer syntax {syntax}")))?;
        let (reader, shared) = reader_at(path, bytes, start, syntax)?;
        Ok(Self { path, bytes, syntax, reader, shared, position: start, sequences: Vec::new(), items: 0 })
    }

    pub(super) fn next(&mut self) -> Result<Option<Element<'_>>> {
        loop {
            self.end_unknown()?;
            let (path, position) = (self.path, self.position);
            let token = match self.reader.advance() {
                None => return Ok(None),
                Some(token) => token.map_err(|e| damaged(path, position, &e))?,
            };
            match token {
                LazyDataToken::ElementHeader(DataElementHeader { tag, vr, len })
                    if self.sequences.is_empty() && is_pixels(tag) =>
                {
                    return Ok(Some(Element::Pixels { tag, vr, length: len.get().map(u64::from) }));
                }
                LazyDataToken::ElementHeader(header) => {
                    return Ok(Some(Element::Value(&self.sequences, header)));
                }
                LazyDataToken::PixelSequenceStart if self.sequences.is_empty() => {
                    return Ok(Some(Element::Pixels { tag: tags::PIXEL_DATA, vr: VR::OB, length: None }));
                }
                LazyDataToken::SequenceStart { tag, .. } => {
                    self.open(tag)?;
                    return Ok(Some(Element::Sequence(&self.sequences[..self.sequences.len() - 1], tag)));
                }
                LazyDataToken::ItemStart { .. } => {
                    self.items += 1;
                    return Ok(Some(Element::Sequence(&self.sequences, ITEM)));
                }
                // A packed icon within a sequence: its fragments are skipped.
                LazyDataToken::PixelSequenceStart => self.open(tags::PIXEL_DATA)?,
                LazyDataToken::LazyItemValue { len, decoder } => {
                    check_end(path, self.bytes, decoder, tags::PIXEL_DATA, len)?;
                    decoder.skip_bytes(len).map_err(|e| damaged(path, position, &e))?;
                }
                // The parser presumes that every end has a start.
                LazyDataToken::ItemEnd if self.items > 0 => self.items -= 1,
                LazyDataToken::SequenceEnd if !self.sequences.is_empty() => {
                    self.sequences.pop();
                }
                _ => return Err(damaged(self.path, self.position, &"an end without a beginning")),
            }
        }
    }

    /// Records the start of a sequence.
    fn open(&mut self, tag: Tag) -> Result<()> {
        if self.sequences.len() == DEEPEST {
            return Err(damaged(self.path, self.position, &"sequences nest too deeply"));
        }
        self.sequences.push(tag);
        Ok(())
    }

    /// Gives a sequence of unknown representation without a length its length, if one comes next: it is written without representations
    /// inside, in any syntax, and the parser would take it for explicit.
    fn end_unknown(&self) -> Result<()> {
        let at = self.shared.position.get() as usize;
        let Some(&[g0, g1, _, _, b'U', b'N', 0, 0, 0xff, 0xff, 0xff, 0xff]) =
            self.bytes.get(at..).and_then(|b| b.first_chunk())
        else {
            return Ok(());
        };
        let is_item = u16::from_le_bytes([g0, g1]) == ITEM.0;
        if is_item || self.syntax.uid() != uids::EXPLICIT_VR_LITTLE_ENDIAN {
            return Ok(());
        }
        let end = end_of_implicit(self.bytes, at + 12, 0).and_then(|end| u32::try_from(end - at - 12).ok());
        let length = end.ok_or_else(|| damaged(self.path, at, &"a sequence without an end"))?;
        self.shared.length.set(Some((at as u64 + 8, length.to_le_bytes())));
        Ok(())
    }

    /// Start of the value of the last element.
    pub(super) fn into_position(self) -> u64 {
        self.reader.into_decoder().position()
    }

    /// Reads the value of the last element.
    pub(super) fn read(&mut self, header: &DataElementHeader) -> Result<PrimitiveValue> {
        self.value(header, |decoder, header| decoder.read_value_preserved(header))
    }

    /// Skips the value of the last element.
    pub(super) fn skip(&mut self, header: &DataElementHeader) -> Result<()> {
        self.value(header, |decoder, header| decoder.skip_bytes(header.len.0))
    }

    fn value<T, E: std::error::Error>(
        &mut self,
        header: &DataElementHeader,
        take: impl FnOnce(&mut Decoder<'a>, &DataElementHeader) -> Result<T, E>,
    ) -> Result<T> {
        let (path, position) = (self.path, self.position);
        let Some(Ok(LazyDataToken::LazyValue { decoder, .. })) = self.reader.advance() else {
            return Err(damaged(path, position, &"an element without a value"));
        };
        check_end(path, self.bytes, decoder, header.tag, header.len.0)?;
        let value = take(decoder, header).map_err(|e| damaged(path, position, &e))?;
        self.position = decoder.position() as usize;
        Ok(value)
    }
}

/// Creates a parser at a position, and what it shares.
fn reader_at<'a>(
    path: &Path,
    bytes: &'a [u8],
    start: usize,
    syntax: &TransferSyntax,
) -> Result<(LazyDataSetReader<Decoder<'a>>, Rc<Shared>)> {
    let mut cursor = Cursor::new(bytes);
    cursor.set_position(start as u64);
    let shared = Rc::new(Shared { position: Cell::new(start as u64), length: Cell::new(None) });
    let source = Tracked { cursor, shared: shared.clone() };
    let reader = LazyDataSetReader::new_with_ts(source, syntax).map_err(|e| damaged(path, start, &e))?;
    Ok((reader, shared))
}

/// End of a sequence of undefined length whose items begin here and are written without representations.
fn end_of_implicit(bytes: &[u8], mut at: usize, depth: usize) -> Option<usize> {
    let head = |at: usize| {
        let [g0, g1, e0, e1, l0, l1, l2, l3] = *bytes.get(at..)?.first_chunk::<8>()?;
        let tag = Tag(u16::from_le_bytes([g0, g1]), u16::from_le_bytes([e0, e1]));
        Some((tag, u32::from_le_bytes([l0, l1, l2, l3])))
    };
    // Within an item of undefined length; between items otherwise.
    let mut in_item = false;
    loop {
        let (tag, length) = head(at)?;
        at += 8;
        match (tag, in_item) {
            (SEQUENCE_END, false) => return Some(at),
            (ITEM_END, true) => in_item = false,
            (ITEM, false) if length == UNDEFINED => in_item = true,
            (ITEM, false) => at = at.checked_add(length as usize)?,
            (_, true) if length == UNDEFINED && depth < DEEPEST => at = end_of_implicit(bytes, at, depth + 1)?,
            (_, true) if length != UNDEFINED => at = at.checked_add(length as usize)?,
            _ => return None,
        }
    }
}

/// Refuses a value extending past the file's end.
fn check_end(path: &Path, bytes: &[u8], decoder: &Decoder, tag: Tag, length: u32) -> Result<()> {
    let (end, found) = (decoder.position().saturating_add(length as u64), bytes.len());
    if end <= found as u64 {
        return Ok(());
    }
    let problem = format!("cut short: element {tag} reaches to byte {end}, found {found}; fetch the file again");
    Err(ImportError::invalid(path, problem))
}

fn is_pixels(tag: Tag) -> bool {
    [tags::PIXEL_DATA, tags::FLOAT_PIXEL_DATA, tags::DOUBLE_FLOAT_PIXEL_DATA].contains(&tag)
}

fn damaged(path: &Path, position: usize, error: &dyn std::fmt::Display) -> ImportError {
    ImportError::invalid(path, format!("its header is damaged near byte {position}: {error}; fetch the file again"))
}
