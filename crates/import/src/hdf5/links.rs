//! Links of a group by name, read here because the parser lists no group with an object that it cannot read, and passes over links to other
//! files. Costs some hundred bytes per link.

use super::file::File;
use hdf5_reader::btree_v1::collect_btree_v1_leaves_storage;
use hdf5_reader::btree_v2::{BTreeV2Header, BTreeV2Record, collect_btree_v2_records_storage};
use hdf5_reader::error::{Error, Result};
use hdf5_reader::fractal_heap::{FractalHeap, FractalHeapDirectBlockCache};
use hdf5_reader::io::Cursor;
use hdf5_reader::local_heap::LocalHeap;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::link::{self, LinkTarget};
use hdf5_reader::symbol_table::SymbolTableNode;

/// A link of a group.
pub(super) struct Link {
    pub(super) name: String,
    /// Address of the object; `None` where the link is a path.
    pub(super) object: Option<u64>,
    /// The other file and the path in it, as in `b.h5::/data`, of a link to one.
    pub(super) other_file: Option<String>,
    /// Its place in the order of creation, if the group keeps that.
    created: Option<u64>,
}

/// The links of a group, in the order of their creation or as they are stored.
pub(super) fn links_of(file: &File, group: u64) -> Result<Vec<Link>> {
    let superblock = file.hdf.superblock();
    let (offset, length, storage) = (superblock.offset_size, superblock.length_size, file.hdf.storage());
    let header = file.hdf.get_or_parse_header(group)?;
    let mut links = Vec::new();
    for message in &header.messages {
        match message {
            HdfMessage::SymbolTable(table) => {
                let heap = LocalHeap::parse_at_storage(storage, table.heap_address, offset, length)?;
                // Names are sought in the heap's bytes, read once.
                let bytes = usize::try_from(heap.data_segment_size).map_err(|_| cut())?;
                let names = storage.read_range(heap.data_segment_address, bytes)?;
                let nodes =
                    collect_btree_v1_leaves_storage(storage, table.btree_address, offset, length, None, &[], None)?;
                for (_, address) in nodes {
                    // Two bytes after the version and a blank count the entries.
                    let start = storage.read_range(address, 8)?;
                    let count = start.get(6..8).map_or(0, |bytes| usize::from(bytes[0]) | usize::from(bytes[1]) << 8);
                    let node = storage.read_range(address, 8 + count * (2 * usize::from(offset) + 24))?;
                    let node = SymbolTableNode::parse(&mut Cursor::new(&node), offset, length)?;
                    for entry in node.entries {
                        let rest = usize::try_from(entry.link_name_offset).ok().and_then(|at| names.get(at..));
                        let name = rest.and_then(|rest| rest.split(|byte| *byte == 0).next()).ok_or_else(cut)?;
                        let name = std::str::from_utf8(name).map_err(|_| cut())?.to_owned();
                        let object = (entry.cache_type != 2).then_some(entry.object_header_address);
                        links.push(Link { name, object, other_file: None, created: None });
                    }
                }
            }
            HdfMessage::Link(found) => links.push(link_of(found)),
            HdfMessage::LinkInfo(info) if !Cursor::is_undefined_offset(info.fractal_heap_address, offset) => {
                let heap = FractalHeap::parse_at_storage(storage, info.fractal_heap_address, offset, length)?;
                let tree = BTreeV2Header::parse_at_storage(storage, info.btree_name_index_address, offset, length)?;
                let records = collect_btree_v2_records_storage(storage, &tree, offset, length, None, &[], None)?;
                let mut blocks = FractalHeapDirectBlockCache::default();
                for record in records {
                    let BTreeV2Record::LinkNameHash { heap_id, .. } = record else {
                        return Err(Error::InvalidData("an index of other records than links".into()));
                    };
                    let bytes = heap.get_object_storage_cached(&heap_id, storage, offset, length, &mut blocks)?;
                    links.push(link_of(&link::parse(&mut Cursor::new(&bytes), offset, length, bytes.len())?));
                }
            }
            _ => {}
        }
    }
    if links.iter().all(|link| link.created.is_some()) {
        links.sort_by_key(|link| link.created);
    }
    Ok(links)
}

fn cut() -> Error {
    Error::InvalidData("a group's names lie outside their heap".into())
}

fn link_of(found: &link::LinkMessage) -> Link {
    let (object, other_file) = match &found.target {
        LinkTarget::External { filename, path } => (None, Some(format!("{filename}::{path}"))),
        LinkTarget::Hard { address } => (Some(*address), None),
        LinkTarget::Soft { .. } => (None, None),
    };
    Link { name: found.name.clone(), object, other_file, created: found.creation_order }
}
