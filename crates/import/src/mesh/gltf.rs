//! glTF 2.0, as `.gltf` with its buffers inside or beside it, or `.glb`: all triangles of the scene, placed by its nodes, in the pose
//! without animation. Colours are the vertices' times the material's, encoded from linear light to picture codes.
//!
//! Files are not trusted: named buffers must lie in the file's folder, and declared sizes are checked before any allocation.

use super::{Parts, code};
use crate::error::{ImportError, Result};
use crate::files::folder_of;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use glam::{DMat3, DMat4, DVec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Node, Primitive, Semantic};
use std::borrow::Cow;
use std::path::{Component, Path, PathBuf};

/// Most memory for a JSON document's contents: up to [`CONTAINER_BYTES`] per object and list, and [`VALUE_BYTES`] per value in one.
const MOST_JSON_BYTES: u64 = 1 << 30;
const CONTAINER_BYTES: u64 = 600;
const VALUE_BYTES: u64 = 32;

/// Bytes of a vertex (position, normal and colour), and of a triangle (three indices).
const VERTEX_BYTES: u64 = 27;
const TRIANGLE_BYTES: u64 = 12;
/// Most memory for copies of meshes: this, or [`MOST_COPIES`] times the buffers.
const MOST_PLACED_BYTES: u64 = 1 << 30;
const MOST_COPIES: u64 = 8;

/// Bytes before the parts of a binary file.
const BINARY_HEADER: usize = 12;

pub(super) fn read(path: &Path, bytes: Vec<u8>) -> Result<Parts> {
    let bad = |problem: String| ImportError::invalid(path, problem);
    let (document, blob) = document(&bytes).map_err(bad)?;
    if let Some(extension) = document.extensions_required().next() {
        return Err(ImportError::unsupported(path, format!("the glTF extension {extension}")));
    }
    let buffers = buffers(path, &document, blob)?;
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let Some(scene) = scene else { return Err(bad("the file has no scene".into())) };
    let nodes = placed_nodes(&document, scene.nodes().collect()).map_err(bad)?;
    check_size(&nodes, &buffers).map_err(bad)?;
    let mut parts = Parts::default();
    for (node, world_from_node) in nodes {
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            let part = primitive_parts(&primitive, &buffers, world_from_node)
                .map_err(|problem| bad(format!("the mesh of node {}: {problem}", node.index())))?;
            parts.join(part);
        }
    }
    Ok(parts)
}

/// Splits a file into its document and its binary part.
fn document(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), String> {
    let not_gltf = |error: gltf::Error| format!("expected a glTF file: {error}");
    let (json, blob) = if bytes.starts_with(b"glTF") {
        // The library subtracts the header from the declared length.
        let length = bytes.get(8..BINARY_HEADER).map_or(0, |n| u32::from_le_bytes([n[0], n[1], n[2], n[3]]));
        if (length as usize) < BINARY_HEADER {
            return Err(format!("expected a glTF file of at least {BINARY_HEADER} bytes, found a length of {length}"));
        }
        let parts = gltf::binary::Glb::from_slice(bytes).map_err(not_gltf)?;
        (parts.json, parts.bin.map(Cow::into_owned))
    } else {
        (Cow::Borrowed(bytes), None)
    };
    let needed = json_bytes(&json);
    if needed > MOST_JSON_BYTES {
        let [needed, most] = [needed, MOST_JSON_BYTES].map(|bytes| bytes >> 20);
        return Err(format!(
            "its JSON would take up to {needed} MiB, more than {most}: save the mesh with fewer nodes"
        ));
    }
    let root: gltf::json::Root = gltf::json::deserialize::from_slice(&json).map_err(|error| not_gltf(error.into()))?;
    // The library's check of a primitive presumes that its accessors exist.
    let accessors = root.accessors.len();
    let named =
        root.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|primitive| primitive.attributes.values());
    if let Some(missing) = named.map(|accessor| accessor.value()).find(|&accessor| accessor >= accessors) {
        return Err(format!("a mesh names accessor {missing}, but there are {accessors}, numbered from 0"));
    }
    Ok((Document::from_json(root).map_err(not_gltf)?, blob))
}

/// Upper bound of a parsed JSON document's memory, from its objects, lists and values.
fn json_bytes(json: &[u8]) -> u64 {
    let (mut containers, mut values) = (0, 0);
    let mut bytes = json.iter();
    while let Some(byte) = bytes.next() {
        match byte {
            b'{' | b'[' => containers += 1,
            b',' => values += 1,
            // To the string's end, which an escaped quote is not.
            b'"' => {
                while let Some(byte) = bytes.next() {
                    match byte {
                        b'"' => break,
                        b'\\' => drop(bytes.next()),
                        _ => {}
                    }
                }
            }
            _ => {}
        }
    }
    containers * CONTAINER_BYTES + values * VALUE_BYTES + json.len() as u64
}

/// Nodes of a tree, each with its transform to the world.
fn placed_nodes<'a>(document: &Document, roots: Vec<Node<'a>>) -> Result<Vec<(Node<'a>, DMat4)>, String> {
    let mut is_placed = vec![false; document.nodes().len()];
    let mut open: Vec<(Node<'_>, DMat4)> = roots.into_iter().map(|node| (node, DMat4::IDENTITY)).collect();
    let mut placed = Vec::new();
    while let Some((node, world_from_parent)) = open.pop() {
        if std::mem::replace(&mut is_placed[node.index()], true) {
            return Err(format!("node {} is the child of two nodes: expected a tree", node.index()));
        }
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        let world_from_node = world_from_parent * DMat4::from_cols_array_2d(&own);
        open.extend(node.children().map(|child| (child, world_from_node)));
        placed.push((node, world_from_node));
    }
    Ok(placed)
}

/// Checks the total memory of the nodes' meshes; many nodes may show the same one.
fn check_size(nodes: &[(Node<'_>, DMat4)], buffers: &[Vec<u8>]) -> Result<(), String> {
    let bytes_of = |primitive: Primitive<'_>| {
        let vertices = primitive.get(&Semantic::Positions).map_or(0, |accessor| accessor.count() as u64);
        let corners = primitive.indices().map_or(vertices, |accessor| accessor.count() as u64);
        let triangles = if primitive.mode() == Mode::Triangles { corners / 3 } else { corners };
        vertices.saturating_mul(VERTEX_BYTES).saturating_add(triangles.saturating_mul(TRIANGLE_BYTES))
    };
    let meshes = nodes.iter().filter_map(|(node, _)| node.mesh());
    let needed = meshes.flat_map(|mesh| mesh.primitives()).map(bytes_of).fold(0, u64::saturating_add);
    let own: u64 = buffers.iter().map(|buffer| buffer.len() as u64).sum();
    let most = MOST_PLACED_BYTES.max(own.saturating_mul(MOST_COPIES));
    if needed > most {
        let [needed, most] = [needed, most].map(|bytes| bytes >> 20);
        return Err(format!(
            "with all its copies the mesh would take {needed} MiB, more than {most}: save it with fewer nodes of the same mesh"
        ));
    }
    Ok(())
}

/// Reads each buffer: in the file itself, beside it, or encoded in its URI.
fn buffers(path: &Path, document: &Document, mut blob: Option<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
    let mut buffers = Vec::new();
    let mut named = Vec::new();
    for buffer in document.buffers() {
        let bad = |problem: String| ImportError::invalid(path, format!("buffer {}: {problem}", buffer.index()));
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => blob.take().ok_or_else(|| bad("the file has no binary part".into()))?,
            gltf::buffer::Source::Uri(uri) => match uri.split_once(";base64,") {
                Some((kind, text)) if kind.starts_with("data:") => {
                    BASE64_STANDARD.decode(text).map_err(|error| bad(format!("not in base 64: {error}")))?
                }
                _ => {
                    let shown: String = uri.chars().take(80).collect();
                    let beside = file_beside(path, uri)?.ok_or_else(|| {
                        bad(format!("it is at {shown}: expected a file in the folder of this one; copy it there"))
                    })?;
                    // Otherwise a file could be read over and over.
                    if named.contains(&beside) {
                        return Err(bad(format!("it is at {shown}, as one before it: expected a file for each")));
                    }
                    let bytes = super::read_file(&beside)?;
                    named.push(beside);
                    bytes
                }
            },
        };
        if bytes.len() < buffer.length() {
            return Err(bad(format!("expected {} bytes, found {}: it is cut short", buffer.length(), bytes.len())));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// Resolves a name to a file in the folder of `path`, or below; `None` if it leads elsewhere.
fn file_beside(path: &Path, uri: &str) -> Result<Option<PathBuf>> {
    let name = PathBuf::from(unescaped(uri));
    let is_below = name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    if uri.contains(':') || !is_below {
        return Ok(None);
    }
    let folder = folder_of(path);
    let beside = folder.join(name);
    // Links, too, must lead there.
    let real = |path: &Path| path.canonicalize().map_err(ImportError::io(path));
    Ok(real(&beside)?.starts_with(real(folder)?).then_some(beside))
}

/// Decodes `%20` and the like in a name.
fn unescaped(uri: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let digits = after.get(..2).and_then(|digits| std::str::from_utf8(digits).ok());
        match digits.filter(|_| first == b'%').and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) => (bytes.push(byte), rest = &after[2..]),
            None => (bytes.push(first), rest = after),
        };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Triangles of a primitive; none for points and lines.
fn primitive_parts(primitive: &Primitive<'_>, buffers: &[Vec<u8>], world_from_node: DMat4) -> Result<Parts, String> {
    if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        return Ok(Parts::default());
    }
    for (semantic, accessor) in primitive.attributes() {
        let (kinds, shapes): (&[DataType], &[Dimensions]) = match semantic {
            Semantic::Positions | Semantic::Normals => (&[DataType::F32], &[Dimensions::Vec3]),
            Semantic::Colors(0) => {
                (&[DataType::F32, DataType::U8, DataType::U16], &[Dimensions::Vec3, Dimensions::Vec4])
            }
            _ => continue,
        };
        check(&accessor, buffers, kinds, shapes)?;
    }
    if let Some(accessor) = primitive.indices() {
        check(&accessor, buffers, &[DataType::U8, DataType::U16, DataType::U32], &[Dimensions::Scalar])?;
    }
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
    let positions = reader.read_positions().ok_or("it has no positions")?;
    let place = |p: [f32; 3]| world_from_node.transform_point3(DVec3::from_array(p.map(f64::from)));
    let positions: Vec<[f32; 3]> = positions.map(|p| place(p).as_vec3().to_array()).collect();
    let across = DMat3::from_mat4(world_from_node).inverse().transpose();
    let turn = |n: [f32; 3]| (across * DVec3::from_array(n.map(f64::from))).normalize_or_zero().as_vec3().to_array();
    let normals = reader.read_normals().map(|normals| normals.map(turn).collect()).unwrap_or_default();
    let [r, g, b, _] = primitive.material().pbr_metallic_roughness().base_color_factor().map(f64::from);
    let color = |light: [f64; 3]| [light[0] * r, light[1] * g, light[2] * b].map(|c| code(encoded(c)));
    let colors = match reader.read_colors(0) {
        Some(colors) => colors.into_rgb_f32().map(|c| color(c.map(f64::from))).collect(),
        None if primitive.material().index().is_some() => vec![color([1.0; 3]); positions.len()],
        None => Vec::new(),
    };
    let count = u32::try_from(positions.len()).map_err(|_| "it has too many vertices")?;
    let indices: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..count).collect(),
    };
    if let Some(index) = indices.iter().find(|&&index| index >= count) {
        return Err(format!("a triangle names vertex {index}, but there are {count}, numbered from 0"));
    }
    Ok(Parts { triangles: triangles(primitive.mode(), &indices), positions, normals, colors })
}

fn triangles(mode: Mode, indices: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => indices.windows(3).map(|w| [w[0], w[1], w[2]]).collect(),
        Mode::TriangleFan => indices.windows(2).skip(1).map(|w| [indices[0], w[0], w[1]]).collect(),
        _ => indices.chunks_exact(3).map(|w| [w[0], w[1], w[2]]).collect(),
    }
}

/// Checks an accessor's type, and that it lies inside its buffer: the library reads it unchecked.
fn check(
    accessor: &Accessor<'_>,
    buffers: &[Vec<u8>],
    kinds: &[DataType],
    shapes: &[Dimensions],
) -> Result<(), String> {
    let name = format!("accessor {}", accessor.index());
    if !kinds.contains(&accessor.data_type()) || !shapes.contains(&accessor.dimensions()) {
        let (kind, shape) = (accessor.data_type(), accessor.dimensions());
        return Err(format!("{name} holds {shape:?} of {kind:?}: expected {shapes:?} of {kinds:?}"));
    }
    if accessor.sparse().is_some() {
        return Err(format!("{name} is sparse, which is not supported: save the mesh without sparse accessors"));
    }
    let Some(view) = accessor.view() else { return Err(format!("{name} has no data")) };
    let size = accessor.size() as u64;
    let stride = view.stride().map_or(size, |stride| stride as u64);
    let rest = (accessor.count() as u64).checked_sub(1).and_then(|n| n.checked_mul(stride));
    let end = rest.and_then(|rest| rest.checked_add(accessor.offset() as u64)?.checked_add(size));
    let end_of_view = (view.offset() as u64).checked_add(view.length() as u64);
    let there = buffers.get(view.buffer().index()).map_or(0, |buffer| buffer.len() as u64);
    let is_inside = end.is_some_and(|end| end <= view.length() as u64) && end_of_view.is_some_and(|end| end <= there);
    match is_inside && stride >= size {
        true => Ok(()),
        false => Err(format!("{name} of {} values reaches past its buffer, or is empty", accessor.count())),
    }
}

/// sRGB encoding of linear light.
fn encoded(light: f64) -> f64 {
    if light <= 0.0031308 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}
