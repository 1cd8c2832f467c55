//! Attributes of a committed (named) datatype, an object of its own to which the attribute points. The parser reads no object with one, so they
//! are read here and hidden from it. Costs a second walk over the header of such an object, in its memory.

use super::file::{File, MOST_HEADER_BYTES, cause_of};
use hdf5_reader::Attribute;
use hdf5_reader::btree_v2::{BTreeV2Header, BTreeV2Record, collect_btree_v2_records_storage};
use hdf5_reader::checksum::jenkins_lookup3;
use hdf5_reader::error::{Error, Result};
use hdf5_reader::fractal_heap::{FractalHeap, FractalHeapDirectBlockCache};
use hdf5_reader::io::Cursor;
use hdf5_reader::messages::attribute::AttributeMessage;
use hdf5_reader::messages::attribute_info::AttributeInfoMessage;
use hdf5_reader::messages::shared::SharedMessage;
use hdf5_reader::messages::{
    HdfMessage, MSG_ATTRIBUTE, MSG_ATTRIBUTE_INFO, MSG_CONTINUATION, MSG_DATATYPE, attribute, attribute_info,
    dataspace, datatype, shared,
};
use std::collections::HashSet;

/// Most attributes kept apart from an object's header.
const MOST_ATTRIBUTES: usize = 1 << 16;
/// Flags of an attribute: its datatype, its dataspace lie elsewhere. Of a message: all of it does.
const IS_DATATYPE_SHARED: u8 = 1;
const IS_DATASPACE_SHARED: u8 = 2;
const IS_MESSAGE_SHARED: u8 = 2;
/// Bytes of an index before the address of its root.
const ROOT_AT: usize = 16;
/// Bytes of the checksum that ends a part of a newer header, or an index.
const CHECKSUM_BYTES: usize = 4;

/// Attributes hidden from the parser.
#[derive(Default)]
pub(super) struct Hidden {
    pub(super) attributes: Vec<Attribute>,
    /// Names of those that cannot be read.
    pub(super) unread: Vec<String>,
}

/// Whether the parser failed by such an attribute.
pub(super) fn is_cause(error: &Error) -> bool {
    matches!(cause_of(error), Error::UnsupportedEncoding(problem) if problem.contains("shared datatype/dataspace in attribute"))
}

/// Hides the attributes of committed datatypes of the object at an address.
///
/// # Errors
/// If its header is damaged.
pub(super) fn hide(file: &File, object: u64) -> Result<Hidden> {
    let mut walk = Walk { file, hidden: Hidden::default(), rest: Vec::new() };
    let start = walk.read(object, 6)?;
    let part = if start.starts_with(b"OHDR") { walk.newer(object)? } else { walk.older(object)? };
    walk.rest.push(part);
    let (mut seen, mut bytes) = (HashSet::new(), 0usize);
    while let Some(part) = walk.rest.pop() {
        bytes = bytes.saturating_add(part.bytes);
        if !seen.insert(part.at) || bytes > MOST_HEADER_BYTES {
            return Err(Error::InvalidData("parts of an object's header follow one another without end".into()));
        }
        walk.part(&part)?;
    }
    Ok(walk.hidden)
}

/// A part of an object's header in one piece.
struct Part {
    at: u64,
    bytes: usize,
    /// Bytes before the first message.
    head: usize,
    /// Whether it is of version 2: messages are packed, and a checksum ends it.
    is_newer: bool,
    /// Whether messages have a place in the order of creation.
    has_order: bool,
}

struct Walk<'a> {
    file: &'a File,
    hidden: Hidden,
    rest: Vec<Part>,
}

fn cut() -> Error {
    Error::InvalidData("an object's header is cut short".into())
}

/// A little-endian number of up to 8 bytes.
fn number(bytes: &[u8], at: usize, size: usize) -> Result<u64> {
    let there = at.checked_add(size).and_then(|end| bytes.get(at..end)).filter(|_| size <= 8).ok_or_else(cut)?;
    Ok(there.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte)))
}

impl Walk<'_> {
    fn read(&self, at: u64, bytes: usize) -> Result<Vec<u8>> {
        if bytes > MOST_HEADER_BYTES {
            return Err(cut());
        }
        Ok(self.file.hdf.storage().read_range(at, bytes)?.to_vec())
    }

    fn offset_size(&self) -> u8 {
        self.file.hdf.superblock().offset_size
    }

    fn length_size(&self) -> u8 {
        self.file.hdf.superblock().length_size
    }

    /// The first part of a header of version 1.
    fn older(&self, at: u64) -> Result<Part> {
        const HEAD: usize = 16;
        let start = self.read(at, HEAD)?;
        if start.first() != Some(&1) {
            return Err(Error::InvalidData("an object's header of an unknown version".into()));
        }
        let bytes = usize::try_from(number(&start, 8, 4)?).map_err(|_| cut())?;
        Ok(Part { at, bytes: HEAD.saturating_add(bytes), head: HEAD, is_newer: false, has_order: false })
    }

    /// The first part of a header of version 2.
    fn newer(&self, at: u64) -> Result<Part> {
        let flags = number(&self.read(at, 6)?, 5, 1)?;
        let times = if flags & 0x20 != 0 { 16 } else { 0 };
        let limits = if flags & 0x10 != 0 { 4 } else { 0 };
        let (place, width) = (6 + times + limits, 1 << (flags & 3));
        let size = usize::try_from(number(&self.read(at, place + width)?, place, width)?).map_err(|_| cut())?;
        let head = place + width;
        let bytes = head.saturating_add(size).saturating_add(CHECKSUM_BYTES);
        Ok(Part { at, bytes, head, is_newer: true, has_order: flags & 4 != 0 })
    }

    /// Walks over the messages of a part, and hides attributes in it.
    fn part(&mut self, part: &Part) -> Result<()> {
        let mut bytes = self.read(part.at, part.bytes)?;
        let end = bytes.len().checked_sub(if part.is_newer { CHECKSUM_BYTES } else { 0 }).ok_or_else(cut)?;
        if part.is_newer && number(&bytes, end, CHECKSUM_BYTES)? != u64::from(jenkins_lookup3(&bytes[..end])) {
            return Err(Error::InvalidData("a checksum of an object's header does not match".into()));
        }
        let head = match (part.is_newer, part.has_order) {
            (false, _) => 8,
            (true, false) => 4,
            (true, true) => 6,
        };
        let (mut at, mut is_changed) = (part.head, false);
        while at + head <= end {
            let (kind_bytes, flags_at) = if part.is_newer { (1, 3) } else { (2, 4) };
            let kind = number(&bytes, at, kind_bytes)? as u16;
            let size = number(&bytes, at + kind_bytes, 2)? as usize;
            let flags = number(&bytes, at + flags_at, 1)? as u8;
            let body = at + head..at + head + size;
            if body.end > end {
                return Err(cut());
            }
            let message = bytes.get(body.clone()).ok_or_else(cut)?;
            match kind {
                _ if flags & IS_MESSAGE_SHARED != 0 => {}
                MSG_CONTINUATION => self.follow(message, part)?,
                MSG_ATTRIBUTE if is_shared(message) => {
                    self.take(message);
                    // A blank.
                    bytes[at..at + kind_bytes].fill(0);
                    is_changed = true;
                }
                MSG_ATTRIBUTE_INFO => {
                    let (offset, length) = (self.offset_size(), self.length_size());
                    let info = attribute_info::parse(&mut Cursor::new(message), offset, length, size)?;
                    self.take_dense(&info)?;
                }
                _ => {}
            }
            if self.hidden.attributes.len() + self.hidden.unread.len() > MOST_ATTRIBUTES {
                return Err(Error::InvalidData(format!("more than {MOST_ATTRIBUTES} attributes")));
            }
            at = body.end;
        }
        if is_changed {
            if part.is_newer {
                let sum = jenkins_lookup3(&bytes[..end]).to_le_bytes();
                bytes[end..].copy_from_slice(&sum);
            }
            self.file.bytes.replace(self.file.base().saturating_add(part.at), bytes)?;
        }
        Ok(())
    }

    /// Adds the part to which a message points.
    fn follow(&mut self, message: &[u8], part: &Part) -> Result<()> {
        let (offset, length) = (usize::from(self.offset_size()), usize::from(self.length_size()));
        let at = number(message, 0, offset)?;
        let bytes = usize::try_from(number(message, offset, length)?).map_err(|_| cut())?;
        // A newer part begins with letters.
        self.rest.push(Part { at, bytes, head: if part.is_newer { 4 } else { 0 }, ..*part });
        Ok(())
    }

    /// Keeps an attribute, or its name.
    fn take(&mut self, message: &[u8]) {
        match self.attribute(message) {
            Ok(found) => self.hidden.attributes.push(found),
            Err(_) => self.hidden.unread.push(name_of(message).unwrap_or_else(|| "(no name)".into())),
        }
    }

    /// Keeps all attributes of a heap if one of them has a committed datatype. The parser, which holds their object's header by now, sees their
    /// indices empty.
    fn take_dense(&mut self, info: &AttributeInfoMessage) -> Result<()> {
        let (offset, length, storage) = (self.offset_size(), self.length_size(), self.file.hdf.storage());
        if Cursor::is_undefined_offset(info.fractal_heap_address, offset) {
            return Ok(());
        }
        let heap = FractalHeap::parse_at_storage(storage, info.fractal_heap_address, offset, length)?;
        let tree = BTreeV2Header::parse_at_storage(storage, info.btree_name_index_address, offset, length)?;
        let records = collect_btree_v2_records_storage(storage, &tree, offset, length, None, &[], None)?;
        let mut blocks = FractalHeapDirectBlockCache::default();
        let mut messages = Vec::new();
        for record in records {
            let BTreeV2Record::AttributeNameHash { heap_id, .. } = record else {
                return Err(Error::InvalidData("an index of other records than attributes".into()));
            };
            messages.push(heap.get_object_storage_cached(&heap_id, storage, offset, length, &mut blocks)?);
        }
        if !messages.iter().any(|message| is_shared(message)) {
            return Ok(());
        }
        messages.iter().for_each(|message| self.take(message));
        let indices = [Some(info.btree_name_index_address), info.btree_creation_order_address];
        for at in indices.into_iter().flatten().filter(|at| !Cursor::is_undefined_offset(*at, offset)) {
            self.empty(at)?;
        }
        Ok(())
    }

    /// Has the parser find an index without records.
    fn empty(&self, tree: u64) -> Result<()> {
        let (offset, length) = (self.offset_size(), self.length_size());
        BTreeV2Header::parse_at_storage(self.file.hdf.storage(), tree, offset, length)?;
        // The root's address and two counts end it, before the checksum.
        let end = ROOT_AT + usize::from(offset) + 2 + usize::from(length);
        let mut bytes = self.read(tree, end + CHECKSUM_BYTES)?;
        bytes[ROOT_AT..end].fill(0);
        bytes[ROOT_AT..ROOT_AT + usize::from(offset)].fill(0xff);
        let sum = jenkins_lookup3(&bytes[..end]).to_le_bytes();
        bytes[end..].copy_from_slice(&sum);
        self.file.bytes.replace(self.file.base().saturating_add(tree), bytes)
    }

    fn attribute(&self, message: &[u8]) -> Result<Attribute> {
        let (offset, length) = (self.offset_size(), self.length_size());
        let found = if is_shared(message) {
            self.shared(message)?
        } else {
            attribute::parse(&mut Cursor::new(message), offset, length, message.len())?
        };
        let base = usize::try_from(self.file.base()).map_err(|_| cut())?;
        Ok(Attribute::from_message_with_context(found, self.file.map.get(base..), offset))
    }

    /// An attribute of version 2 or 3 whose datatype is committed.
    fn shared(&self, message: &[u8]) -> Result<AttributeMessage> {
        let (offset, length) = (self.offset_size(), self.length_size());
        let Sizes { datatype: datatype_bytes, dataspace: dataspace_bytes, name } = Sizes::of(message)?;
        let mut rest = Cursor::new(message);
        rest.skip(name.end)?;
        let kind = rest.read_bytes(datatype_bytes)?;
        let kind = if message.get(1).is_some_and(|flags| flags & IS_DATATYPE_SHARED != 0) {
            let found = shared::parse(&mut Cursor::new(kind), MSG_DATATYPE, offset, length, kind.len())?;
            let SharedMessage::SharedInOhdr { address, .. } = found else {
                return Err(Error::UnsupportedEncoding("a datatype in a table of shared messages".into()));
            };
            let header = self.file.hdf.get_or_parse_header(address)?;
            let found = header.messages.iter().find_map(|message| match message {
                HdfMessage::Datatype(kind) => Some(kind.clone()),
                _ => None,
            });
            found.ok_or_else(|| Error::InvalidData("a committed datatype that is none".into()))?
        } else {
            datatype::parse(&mut Cursor::new(kind), kind.len())?
        };
        if message.get(1).is_some_and(|flags| flags & IS_DATASPACE_SHARED != 0) {
            return Err(Error::UnsupportedEncoding("a shared dataspace".into()));
        }
        let space = rest.read_bytes(dataspace_bytes)?;
        let space = dataspace::parse(&mut Cursor::new(space), offset, length, space.len())?;
        let count = space.num_elements()?.checked_mul(kind.size.into());
        let count = count.and_then(|count| usize::try_from(count).ok()).ok_or_else(cut)?;
        let raw_data = rest.read_bytes(count)?.to_vec();
        let name = name_of(message).ok_or_else(cut)?;
        Ok(AttributeMessage { name, datatype: kind.datatype, dataspace: space, raw_data })
    }
}

/// Sizes at the start of an attribute of version 2 or 3.
struct Sizes {
    datatype: usize,
    dataspace: usize,
    /// Bytes of the name.
    name: std::ops::Range<usize>,
}

impl Sizes {
    fn of(message: &[u8]) -> Result<Self> {
        let size = |at| number(message, at, 2).map(|size| size as usize);
        // An encoding of the name follows in version 3.
        let start = if message.first() == Some(&3) { 9 } else { 8 };
        Ok(Self { name: start..start + size(2)?, datatype: size(4)?, dataspace: size(6)? })
    }
}

fn name_of(message: &[u8]) -> Option<String> {
    let name = message.get(Sizes::of(message).ok()?.name)?;
    let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
    Some(String::from_utf8_lossy(name).into_owned())
}

/// Whether an attribute's datatype or dataspace lies elsewhere.
fn is_shared(message: &[u8]) -> bool {
    matches!(message, [2 | 3, flags, ..] if flags & (IS_DATATYPE_SHARED | IS_DATASPACE_SHARED) != 0)
}
