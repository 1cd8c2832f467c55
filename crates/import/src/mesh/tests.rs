//! One tetrahedron in every format, and files to be refused.

use super::read_mesh;
use crate::error::ImportError;
use brickyard_volume::Mesh;
use std::path::PathBuf;

const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 5.0]];
const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

fn file(name: &str, bytes: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read(name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, ImportError> {
    let (_folder, path) = file(name, bytes);
    read_mesh(&path)
}

/// The error message for a file to be refused.
fn refusal(name: &str, bytes: impl AsRef<[u8]>) -> String {
    let error = read(name, bytes).expect_err(name).to_string();
    assert!(error.contains(name), "{error}");
    error
}

/// All corners of all triangles, wherever their vertices are in the file.
fn soup(mesh: &Mesh) -> Vec<[f32; 3]> {
    mesh.triangles().iter().flatten().map(|&i| mesh.positions()[i as usize]).collect()
}

fn expected() -> Vec<[f32; 3]> {
    FACES.iter().flatten().map(|&i| CORNERS[i as usize]).collect()
}

fn stl(header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend(4u32.to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        bytes.extend(face.iter().flat_map(|&i| CORNERS[i as usize]).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

fn ply(format: &str, count: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {count}\n\
         property list uchar int vertex_indices\nend_header\n"
    )
}

fn ply_text() -> String {
    let mut text = ply("ascii", "4");
    for [x, y, z] in CORNERS {
        text += &format!("{x} {y} {z} 255 0 {}\n", x as u8);
    }
    FACES.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    text
}

fn obj() -> String {
    let mut text = "# by hand\nmtllib nowhere.mtl\no tetrahedron\n".to_string();
    CORNERS.iter().for_each(|[x, y, z]| text += &format!("v {x} {y} {z}\n"));
    FACES.iter().for_each(|[a, b, c]| text += &format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    text
}

/// A glTF of the tetrahedron, twice as large and moved by (1, 0, 0) in two nodes. `edit` spoils it.
fn gltf(edit: impl Fn(String) -> String) -> (Vec<u8>, String) {
    let mut buffer: Vec<u8> = CORNERS.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    buffer.extend(FACES.iter().flatten().flat_map(|&i| (i as u16).to_le_bytes()));
    let json = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"translation": [1, 0, 0], "children": [1]}, {"scale": [2, 2, 2], "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.21404114, 0, 1]}}],
        "buffers": [{"byteLength": 72URI}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 24}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [2, 3, 5]},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}]}"#;
    (buffer, edit(json.to_string()))
}

fn glb(edit: impl Fn(String) -> String) -> Vec<u8> {
    let (buffer, json) = gltf(|json| edit(json.replace("URI", "")));
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    let whole = 12 + 8 + json.len() + 8 + buffer.len();
    for word in [2, whole as u32, json.len() as u32, 0x4e4f534a] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(json);
    bytes.extend((buffer.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(buffer);
    bytes
}

#[test]
fn stl_is_read_binary_and_as_text() {
    for header in [&b"made by hand"[..], b"solid made by hand"] {
        let mesh = read("a.stl", stl(header)).unwrap();
        assert_eq!((soup(&mesh), mesh.positions().len()), (expected(), 4));
    }
    for name in ["", " of hands"] {
        let mut text = format!("solid{name}\n");
        for face in FACES {
            text += "facet normal 0 0 0\nouter loop\n";
            for [x, y, z] in face.map(|i| CORNERS[i as usize]) {
                text += &format!("vertex {x} {y} {z:e}\n");
            }
            text += "endloop\nendfacet\n";
        }
        text += "endsolid\n";
        assert_eq!(soup(&read("a.STL", &text).unwrap()), expected());
        assert!(refusal("a.stl", &text[..text.len() - 40]).contains("expected an STL file"));
    }
}

#[test]
fn ply_is_read_binary_and_as_text() {
    let mesh = read("a.ply", ply_text()).unwrap();
    assert_eq!(soup(&mesh), expected());
    assert_eq!(mesh.colors()[1], [255, 0, 2]);
    for is_big in [false, true] {
        let mut bytes = ply(if is_big { "binary_big_endian" } else { "binary_little_endian" }, "2").into_bytes();
        let mut number = |mut word: Vec<u8>| {
            // Least byte first.
            if is_big {
                word.reverse();
            }
            bytes.extend(word);
        };
        for [x, y, z] in CORNERS {
            number(x.to_le_bytes().into());
            number((y as f64).to_le_bytes().into());
            number(z.to_le_bytes().into());
            [0, 255, 0].into_iter().for_each(|c| number(vec![c]));
        }
        for corners in [&[0i32, 2, 1][..], &[0, 1, 2, 3]] {
            number(vec![corners.len() as u8]);
            corners.iter().for_each(|i| number(i.to_le_bytes().into()));
        }
        let mesh = read("a.ply", &bytes).unwrap();
        assert_eq!(mesh.triangles(), [[0, 2, 1], [0, 1, 2], [0, 2, 3]]);
        assert_eq!((mesh.positions(), mesh.colors()[3]), (&CORNERS[..], [0, 255, 0]));
        assert!(refusal("a.ply", &bytes[..bytes.len() - 3]).contains("expected a PLY file"));
    }
}

#[test]
fn obj_is_read() {
    assert_eq!(soup(&read("a.obj", obj()).unwrap()), expected());
    // A byte order mark is not part of its words, nor of the other texts'.
    let marked = |text: String| format!("\u{feff}{text}");
    assert_eq!(soup(&read("a.obj", marked(obj())).unwrap()), expected());
    assert_eq!(soup(&read("a.ply", marked(ply_text())).unwrap()), expected());
    let quad =
        "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 0 1 0\nv 0 1 0 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1 4//1\nf -4 -3 -2\n";
    let mesh = read("a.obj", quad).unwrap();
    assert_eq!(mesh.triangles().len(), 3);
    assert_eq!(mesh.colors()[2], [0, 255, 0]);
}

#[test]
fn gltf_is_read_with_its_buffers_inside_and_beside() {
    let placed: Vec<_> = expected().iter().map(|[x, y, z]| [2.0 * x + 1.0, 2.0 * y, 2.0 * z]).collect();
    // sRGB's code of 0.214 is the middle one.
    let check = |mesh: Mesh| assert_eq!((soup(&mesh), mesh.colors()[0]), (placed.clone(), [255, 128, 0]));
    check(read("a.glb", glb(|json| json)).unwrap());
    let (buffer, json) = gltf(|json| json);
    use base64::Engine;
    let text = base64::prelude::BASE64_STANDARD.encode(&buffer);
    let inside = json.replace("URI", &format!(r#", "uri": "data:application/octet-stream;base64,{text}""#));
    check(read("a.gltf", inside).unwrap());
    let (folder, path) = file("a.gltf", json.replace("URI", r#", "uri": "of%20a.bin""#));
    assert!(read_mesh(&path).unwrap_err().to_string().contains("of a.bin"));
    std::fs::write(folder.path().join("of a.bin"), &buffer).unwrap();
    check(read_mesh(&path).unwrap());
    std::fs::write(folder.path().join("of a.bin"), &buffer[..70]).unwrap();
    let error = read_mesh(&path).unwrap_err().to_string();
    assert!(error.contains("expected 72 bytes, found 70"), "{error}");
}

#[test]
fn what_is_no_mesh_says_what_was_expected() {
    assert!(refusal("a.vtk", "x").contains("expected .stl, .ply, .obj, .gltf or .glb"));
    for name in ["a.stl", "a.ply", "a.obj", "a.gltf", "a.glb"] {
        refusal(name, "");
        refusal(name, "no mesh at all\n");
    }
    assert!(matches!(read_mesh("nowhere.stl".as_ref()), Err(ImportError::Io { .. })));
}

#[test]
fn cut_files_are_refused_wherever_they_end() {
    let files: [(&str, Vec<u8>); 4] =
        [("a.stl", stl(b"x")), ("b.stl", stl(b"solid")), ("a.ply", ply_text().into()), ("a.glb", glb(|json| json))];
    for (name, bytes) in files {
        for end in 0..bytes.len() - 1 {
            // A text may end within its last number.
            if end + 4 < bytes.len() || name != "a.ply" {
                refusal(name, &bytes[..end]);
            }
        }
    }
    // A text cut after whole lines is a mesh with fewer triangles, undetectably. No cut may make the reader panic.
    let text = obj();
    (0..text.len()).for_each(|end| drop(read("a.obj", &text[..end])));
}

#[test]
fn bad_indices_and_numbers_are_named() {
    let negative = ply_text().replace("3 2 0 3\n", "3 2 0 -3\n");
    assert!(refusal("a.ply", negative).contains("below 0"));
    let past = ply_text().replace("3 2 0 3\n", "3 2 0 4\n");
    assert!(refusal("a.ply", past).contains("triangle 3 names vertex 4, but there are 4"));
    assert!(refusal("a.obj", obj().replace("f 3 1 4", "f 3 1 5")).contains("out of bounds"));
    assert!(refusal("a.obj", obj().replace("v 2 0 0", "v 2 nan 0")).contains("expected finite numbers"));
    // The library cannot parse numbers that are not finite.
    assert!(refusal("a.ply", ply_text().replace("2 0 0 255", "inf 0 0 255")).contains("expected a PLY file"));
    let mut bytes = stl(b"x");
    bytes[84 + 12..84 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(refusal("a.stl", bytes).contains("NaN"));
    let missing = ply_text().replace("property double y", "property double w");
    assert!(refusal("a.ply", missing).contains("no property 'y'"));
    let points = ply_text().replace("element face 4", "element face 0");
    assert!(refusal("a.ply", points).contains("no triangle"));
    let endless = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000000000\nend_header\n";
    assert!(refusal("a.ply", endless).contains("no properties"));
}

#[test]
fn what_gltf_says_of_its_buffers_is_checked() {
    let spoil = |from: &str, to: &str| refusal("a.glb", glb(|json| json.replace(from, to)));
    assert!(spoil(r#""count": 12"#, r#""count": 13"#).contains("accessor 1 of 13 values reaches past"));
    assert!(spoil(r#""count": 4"#, r#""count": 0"#).contains("a.glb"));
    assert!(spoil(r#""byteOffset": 48"#, r#""byteOffset": 49"#).contains("reaches past"));
    assert!(spoil("5123", "5126").contains("expected [Scalar]"));
    assert!(spoil(r#""mesh": 0"#, r#""mesh": 0, "children": [0]"#).contains("two nodes"));
    assert!(spoil(r#""mesh": 0"#, r#""mesh": 7"#).contains("expected a glTF file"));
    assert!(spoil(r#""indices": 1, "#, r#""mode": 1, "#).contains("no triangle"));
    let draco = r#""extensionsUsed": ["KHR_draco_mesh_compression"], "extensionsRequired": ["KHR_draco_mesh_compression"], "scene": 0"#;
    assert!(spoil(r#""scene": 0"#, draco).contains("KHR_draco_mesh_compression"));
    let mut bytes = glb(|json| json);
    let last = bytes.len() - 2;
    bytes[last] = 9;
    assert!(refusal("a.glb", bytes).contains("names vertex 9"));
}

/// Files outside the glTF's folder are not read, under any name.
#[cfg(unix)]
#[test]
fn gltf_stays_in_its_own_folder() {
    let (buffer, json) = gltf(|json| json);
    let outside = tempfile::tempdir().unwrap();
    std::fs::write(outside.path().join("b.bin"), &buffer).unwrap();
    let (folder, path) = file("a.gltf", "");
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    std::fs::write(folder.path().join("sub/b.bin"), &buffer).unwrap();
    std::os::unix::fs::symlink(outside.path().join("b.bin"), folder.path().join("link.bin")).unwrap();
    let read = |uri: &str| {
        std::fs::write(&path, json.replace("URI", &format!(r#", "uri": "{uri}""#))).unwrap();
        read_mesh(&path).map_err(|error| error.to_string())
    };
    assert!(read("sub/b.bin").is_ok() && read("./sub/b.bin").is_ok());
    let name = |path: &std::path::Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    let other = format!("../{}/b.bin", name(outside.path()));
    let escaped = other.replace("..", "%2e%2e");
    let absolute = outside.path().join("b.bin").display().to_string();
    for uri in ["/dev/zero", "file:///dev/zero", &other, &escaped, &absolute, "sub/../../x", "link.bin", ".."] {
        let message = read(uri).unwrap_err();
        assert!(message.contains("expected a file in the folder of this one"), "{uri}: {message}");
    }
    assert!(read("sub").unwrap_err().contains("expected a regular file"));
    assert!(read_mesh("/dev/zero.stl".as_ref()).is_err());
    let zero = folder.path().join("zero.stl");
    std::os::unix::fs::symlink("/dev/zero", &zero).unwrap();
    assert!(read_mesh(&zero).unwrap_err().to_string().contains("expected a regular file"));
}

#[test]
fn what_gltf_declares_is_counted_before_it_is_allocated() {
    // 60,000 nodes of one mesh that declares a thousand times its actual vertices.
    let nodes = |json: String| {
        let list = (0..60_000).map(|i| i.to_string()).collect::<Vec<_>>().join(",");
        let node = r#"{"mesh": 0}"#;
        let at = json.find(r#""nodes": [{"#).unwrap();
        let end = at + json[at..].find("}]").unwrap() + 2;
        let all = format!(r#""nodes": [{}]"#, vec![node; 60_000].join(","));
        let json = format!("{}{all}{}", &json[..at], &json[end..]);
        json.replace(r#""scenes": [{"nodes": [0]}]"#, &format!(r#""scenes": [{{"nodes": [{list}]}}]"#))
    };
    assert_eq!(read("a.glb", glb(nodes)).unwrap().positions().len(), 240_000);
    let message = refusal("a.glb", glb(|json| nodes(json).replace(r#""count": 4"#, r#""count": 4000"#)));
    assert!(message.contains("with all its copies the mesh would take") && message.contains("MiB"), "{message}");
    // JSON of little but brackets takes many times its size.
    let message = refusal("a.gltf", format!(r#"{{"nodes": [{}{{}}]}}"#, "{},".repeat(2_000_000)));
    assert!(message.contains("its JSON would take up to 1"), "{message}");
    let string = format!(r#"{{"asset": {{"version": "2.0", "generator": "{}\""}}}}"#, "{},[".repeat(1_000_000));
    assert!(refusal("a.gltf", string).contains("no scene"));
}

#[test]
fn gltf_that_names_what_is_not_there_is_refused() {
    let spoil = |from: &str, to: &str| refusal("a.glb", glb(|json| json.replace(from, to)));
    assert!(spoil(r#""POSITION": 0"#, r#""POSITION": 70"#).contains("accessor 70"));
    spoil(r#""indices": 1"#, r#""indices": 70"#);
    spoil(r#""bufferView": 0"#, r#""bufferView": 70"#);
    let mut short = glb(|json| json);
    short[8..12].copy_from_slice(&5u32.to_le_bytes());
    assert!(refusal("a.glb", short).contains("found a length of 5"));
}
