//! glTF 2.0, as `.gltf` with its buffers inside or beside it, or `.glb`: all triangles of the scene, each where its node puts it, in
//! the pose without animation. Colours are the vertices' times the material's, which glTF counts in light and pictures in codes.

use super::{Parts, code};
use crate::error::ImportError;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use glam::{DMat3, DMat4, DVec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Gltf, Node, Primitive, Semantic};
use std::path::Path;

pub(super) fn read(path: &Path, bytes: Vec<u8>) -> Result<Parts, ImportError> {
    let bad = |problem: String| ImportError::invalid(path, problem);
    let Gltf { document, blob } =
        Gltf::from_slice(&bytes).map_err(|error| bad(format!("expected a glTF file: {error}")))?;
    if let Some(extension) = document.extensions_required().next() {
        return Err(ImportError::unsupported(path, format!("the glTF extension {extension}")));
    }
    let buffers = buffers(path, &document, blob)?;
    let scene = document.default_scene().or_else(|| document.scenes().next());
    let Some(scene) = scene else { return Err(bad("there is no scene in it".into())) };
    let mut parts = Parts::default();
    let mut is_placed = vec![false; document.nodes().len()];
    let mut open: Vec<(Node<'_>, DMat4)> = scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
    while let Some((node, world_from_parent)) = open.pop() {
        if std::mem::replace(&mut is_placed[node.index()], true) {
            return Err(bad(format!("node {} is the child of two nodes: expected a tree", node.index())));
        }
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        let world_from_node = world_from_parent * DMat4::from_cols_array_2d(&own);
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            let part = primitive_parts(&primitive, &buffers, world_from_node)
                .map_err(|problem| bad(format!("the mesh of node {}: {problem}", node.index())))?;
            parts.join(part);
        }
        open.extend(node.children().map(|child| (child, world_from_node)));
    }
    Ok(parts)
}

/// What is in each buffer: of the file itself, beside it, or written out in its name.
fn buffers(path: &Path, document: &Document, mut blob: Option<Vec<u8>>) -> Result<Vec<Vec<u8>>, ImportError> {
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let bad = |problem: String| ImportError::invalid(path, format!("buffer {}: {problem}", buffer.index()));
        let bytes = match buffer.source() {
            gltf::buffer::Source::Bin => blob.take().ok_or_else(|| bad("the file has no binary part".into()))?,
            gltf::buffer::Source::Uri(uri) => match uri.split_once(";base64,") {
                Some((kind, text)) if kind.starts_with("data:") => {
                    BASE64_STANDARD.decode(text).map_err(|error| bad(format!("not in base 64: {error}")))?
                }
                _ if uri.contains(':') => {
                    let shown: String = uri.chars().take(80).collect();
                    return Err(bad(format!("it is at {shown}: expected a file beside this one")));
                }
                _ => {
                    let beside = path.with_file_name(unescaped(uri));
                    std::fs::read(&beside).map_err(ImportError::io(&beside))?
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

/// A name with `%20` and the like replaced by what they stand for.
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

/// The triangles of a primitive; none of points and lines.
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

/// Whether an accessor is of these types and inside of its buffer: the library reads it on trust.
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
        return Err(format!("{name} is sparse, which is not supported: save the mesh without"));
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
        false => Err(format!("{name} of {} values reaches out of its buffer, or is empty", accessor.count())),
    }
}

/// Light as a share of a picture's codes: the curve of sRGB.
fn encoded(light: f64) -> f64 {
    if light <= 0.0031308 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}
