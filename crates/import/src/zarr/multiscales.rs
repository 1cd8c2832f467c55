//! The document of an image: axes, levels with their places, and further systems of coordinates, of any version from 0.1 to 0.6. Reads JSON
//! alone, and costs its size.

use super::affine::Affine;
use super::field::{Field, Ome};
use super::image_axes::{ImageAxis, axes_of_old, read_axes};
use super::transforms::{Transform, read, read_list};
use crate::error::Result;
use crate::note::{Note, Setting};

/// Most levels of an image.
const MOST_LEVELS: usize = 64;

/// An image's document.
#[derive(Debug)]
pub(super) struct Multiscale {
    pub(super) axes: Vec<ImageAxis>,
    /// The finest first.
    pub(super) levels: Vec<Level>,
    /// Systems beside that of `axes`, in which the whole image has a place.
    pub(super) systems: Vec<System>,
    pub(super) notes: Vec<Note>,
}

/// A level, an array.
#[derive(Debug)]
pub(super) struct Level {
    /// Path from the image's group on.
    pub(super) path: String,
    /// Place of the path in the document.
    pub(super) at: String,
    /// From the numbers of voxels to coordinates; `None` if the document tells nothing of it.
    pub(super) map: Option<Affine>,
}

/// A further system of coordinates.
#[derive(Debug)]
pub(super) struct System {
    pub(super) name: String,
    pub(super) axes: Vec<ImageAxis>,
    /// From the coordinates of the image; where `is_inverse`, to them.
    pub(super) map: Affine,
    pub(super) is_inverse: bool,
}

impl Multiscale {
    /// Reads a group's image; `None` if it is none. Of several, the first is read.
    ///
    /// # Errors
    /// If the document is damaged.
    pub(super) fn of(ome: &Ome<'_>) -> Result<Option<Self>> {
        let Some(list) = ome.get("multiscales") else { return Ok(None) };
        let items = list.items("a list of images")?;
        let Some(first) = items.first() else { return Err(list.invalid("at least one image")) };
        let mut notes = Vec::new();
        let version = ome.get("version").or_else(|| first.get("version"));
        notes.extend(version.and_then(|version| unknown_version(version.as_text().unwrap_or_default())));
        if items.len() > 1 {
            let names: Vec<&str> = items[1..].iter().filter_map(|item| item.get("name")?.as_text()).collect();
            let names = if names.is_empty() { String::new() } else { format!(": {}", names.join(", ")) };
            notes.push(Note::warning(format!(
                "The first of {} multiscales is read; the others are left out{names}.",
                items.len()
            )));
        }
        Self::of_item(first, notes).map(Some)
    }

    /// The image, among all of a group, with a level whose path is the one sought, and the level's number; `None` if none has it.
    ///
    /// # Errors
    /// If an image before it, or itself, is damaged.
    pub(super) fn with_level(ome: &Ome<'_>, is_sought: &dyn Fn(&str) -> bool) -> Result<Option<(Self, usize)>> {
        let Some(list) = ome.get("multiscales") else { return Ok(None) };
        for item in &list.items("a list of images")? {
            let image = Self::of_item(item, Vec::new())?;
            if let Some(level) = image.levels.iter().position(|level| is_sought(&level.path)) {
                return Ok(Some((image, level)));
            }
        }
        Ok(None)
    }

    fn of_item(item: &Field<'_>, notes: Vec<Note>) -> Result<Self> {
        match item.get("coordinateSystems") {
            Some(systems) => Self::with_systems(item, &systems, notes),
            None => Self::with_axes(item, notes),
        }
    }

    /// Reads an image of 0.1 to 0.5, whose own transformations follow those of each level.
    fn with_axes(image: &Field<'_>, mut notes: Vec<Note>) -> Result<Self> {
        let axes = match image.get("axes") {
            Some(list) => read_axes(&list)?,
            None if tells_other_axes(image)? => read_axes(&image.need("axes", "a list of axes")?)?,
            None => axes_of_old(),
        };
        let names = names_of(&axes);
        let mut levels = read_levels(image, &names, &mut notes)?;
        if let Some(list) = image.get("coordinateTransformations") {
            match read_list(&list, &names)? {
                Transform::Map(map) if map.outputs() == axes.len() => {
                    for level in &mut levels {
                        let before = level.map.take().unwrap_or_else(|| Affine::identity(axes.len()));
                        let unfit = || list.invalid("finite numbers after those of the levels");
                        level.map = Some(before.then(&map).ok_or_else(unfit)?);
                    }
                }
                Transform::Map(_) => return Err(list.invalid("as many coordinates as axes")),
                Transform::Other(kind) => notes.push(left_out(&list, &kind)),
            }
        }
        Ok(Self { axes, levels, systems: Vec::new(), notes })
    }

    /// Reads an image of 0.6, whose levels all lie in one of its systems.
    fn with_systems(image: &Field<'_>, list: &Field<'_>, mut notes: Vec<Note>) -> Result<Self> {
        let mut systems = Vec::new();
        for item in list.items("a list of coordinate systems")? {
            let name = item.need("name", "the name of a system")?.text("the name of a system")?.to_owned();
            systems.push((name, item.need("axes", "a list of axes")?));
        }
        let named = |name: &str| systems.iter().find(|(other, _)| other == name).map(|(_, axes)| axes);
        let own = system_of_levels(image)?;
        let axes = match &own {
            Some(name) => named(&name.0).ok_or_else(|| name.1.invalid("the name of one of the coordinateSystems"))?,
            None => &systems.first().ok_or_else(|| list.invalid("at least one coordinate system"))?.1,
        };
        let axes = read_axes(axes)?;
        let own = own.map_or_else(|| systems[0].0.clone(), |(name, _)| name);
        let names = names_of(&axes);
        let levels = read_levels(image, &names, &mut notes)?;
        let mut others = Vec::new();
        let transforms = image.get("coordinateTransformations");
        let transforms = transforms.map(|list| list.items("a list of transformations")).transpose()?;
        for item in transforms.into_iter().flatten() {
            let [input, output] = ["input", "output"].map(|end| end_of(&item, end));
            // Those to images of labels place these.
            if [&input, &output].into_iter().flatten().any(|end| !end.is_own()) {
                continue;
            }
            let name = |end: Option<End>| end.and_then(|end| end.name);
            let (other, is_inverse) = match (name(input), name(output)) {
                (Some(input), Some(output)) if output == own => (input, true),
                (Some(input), Some(output)) if input == own => (output, false),
                _ => {
                    notes.push(left_out(&item, &format!("not between {own} and another system")));
                    continue;
                }
            };
            let Some(other_axes) = named(&other).filter(|_| other != own) else {
                notes.push(left_out(&item, &format!("not between {own} and another system")));
                continue;
            };
            let other_axes = read_axes(other_axes)?;
            let inputs = if is_inverse { names_of(&other_axes) } else { names.clone() };
            match read(&item, &inputs)? {
                Transform::Map(map) => {
                    let outputs = if is_inverse { names.len() } else { other_axes.len() };
                    // A document may be valid by the schemas with such a one.
                    if map.outputs() != outputs {
                        notes.push(left_out(&item, &format!("to {} coordinates, not {outputs}", map.outputs())));
                        continue;
                    }
                    others.push(System { name: other, axes: other_axes, map, is_inverse });
                }
                Transform::Other(kind) => notes.push(left_out(&item, &kind)),
            }
        }
        Ok(Self { axes, levels, systems: others, notes })
    }
}

/// Whether a level has a scale of other axes than the five of 0.1 and 0.2, which do not tell them.
fn tells_other_axes(image: &Field<'_>) -> Result<bool> {
    for dataset in datasets_of(image)? {
        let list = dataset.get("coordinateTransformations");
        for item in list.and_then(|list| list.items("").ok()).unwrap_or_default() {
            let numbers = item.get("scale").and_then(|scale| scale.items("").ok());
            if numbers.is_some_and(|numbers| numbers.len() != axes_of_old().len()) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// A warning of a level whose transformations lack a scale, or have several.
fn odd_scales(list: &Field<'_>) -> Option<Note> {
    let items = list.items("").ok()?;
    let count =
        |kind: &str| items.iter().filter(|item| item.get("type").and_then(|it| it.as_text()) == Some(kind)).count();
    let problem = match count("scale") {
        0 if count("translation") == items.len() => "no scale, which is taken as 1",
        0 | 1 => return None,
        _ => "several scales, which are multiplied",
    };
    Some(Note::warning(format!("{} has {problem}.", list.at())).settled_by(Setting::Spacing))
}

/// A warning of a version that is read as the nearest known one.
fn unknown_version(version: &str) -> Option<Note> {
    let known = ["0.1", "0.2", "0.3", "0.4", "0.5", "0.6"];
    // Drafts and candidates: 0.6.dev4, 0.6rc0.
    let is_known = known
        .iter()
        .any(|known| version.strip_prefix(known).is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_digit())));
    let shown: String = version.chars().take(20).collect();
    let note = format!("Version {shown:?} of OME-Zarr is not known: the image is read as one of 0.4 to 0.6.");
    (!is_known).then(|| Note::warning(note))
}

fn names_of(axes: &[ImageAxis]) -> Vec<String> {
    axes.iter().map(|axis| axis.name.clone()).collect()
}

fn left_out(field: &Field<'_>, kind: &str) -> Note {
    let note = format!("The transformation {} ({kind}) is left out: it is not read.", field.at());
    Note::warning(note).settled_by(Setting::Place)
}

/// An end of a transformation.
struct End {
    name: Option<String>,
    /// Path of another image.
    path: Option<String>,
}

impl End {
    fn is_own(&self) -> bool {
        self.path.as_deref().is_none_or(|path| path.is_empty() || path == ".")
    }
}

/// The system at an end of a transformation: an object, or in drafts its name.
fn end_of(field: &Field<'_>, end: &str) -> Option<End> {
    let end = field.get(end)?;
    if let Some(name) = end.as_text() {
        return Some(End { name: Some(name.into()), path: None });
    }
    let text = |name: &str| Some(end.get(name)?.as_text()?.to_owned());
    Some(End { name: text("name"), path: text("path") })
}

/// The system in which all levels lie, with the field that names it; `None` if no level tells.
fn system_of_levels<'a>(image: &Field<'a>) -> Result<Option<(String, Field<'a>)>> {
    let mut found: Option<(String, Field<'a>)> = None;
    for dataset in datasets_of(image)? {
        let Some(list) = dataset.get("coordinateTransformations") else { continue };
        let Some(last) = list.items("a list of transformations")?.pop() else { continue };
        let name = end_of(&last, "output").and_then(|end| end.name);
        let (Some(own), Some(field)) = (name, last.get("output")) else { continue };
        match &found {
            Some((name, _)) if *name != own => {
                return Err(field.invalid(&format!("{name}, the system of the levels before")));
            }
            Some(_) => {}
            None => found = Some((own, field)),
        }
    }
    Ok(found)
}

fn datasets_of<'a>(image: &Field<'a>) -> Result<Vec<Field<'a>>> {
    let list = image.need("datasets", "a list of levels")?;
    let datasets = list.items("a list of levels")?;
    match datasets.len() {
        1..=MOST_LEVELS => Ok(datasets),
        _ => Err(list.invalid(&format!("1 to {MOST_LEVELS} levels"))),
    }
}

fn read_levels(image: &Field<'_>, names: &[String], notes: &mut Vec<Note>) -> Result<Vec<Level>> {
    let mut levels = Vec::new();
    let mut odd = None;
    for dataset in datasets_of(image)? {
        let path = dataset.need("path", "the path of an array")?;
        let list = dataset.get("coordinateTransformations");
        let list = list.filter(|list| !list.items("").is_ok_and(|items| items.is_empty()));
        odd = odd.or_else(|| odd_scales(list.as_ref()?));
        let map = match list {
            None => None,
            Some(list) => match read_list(&list, names)? {
                Transform::Map(map) if map.outputs() == names.len() => Some(map),
                Transform::Map(_) => return Err(list.invalid("as many coordinates as axes")),
                Transform::Other(kind) => {
                    notes.push(left_out(&list, &kind));
                    None
                }
            },
        };
        levels.push(Level { path: path.text("the path of an array")?.to_owned(), at: path.at().to_owned(), map });
    }
    notes.extend(odd);
    Ok(levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::said;
    use serde_json::{Value, json};

    fn read(document: &Value) -> Result<Multiscale, String> {
        Ok(Multiscale::of(&Ome::in_test(document)).map_err(|error| error.to_string())?.unwrap())
    }

    fn names(multiscale: &Multiscale) -> String {
        names_of(&multiscale.axes).join(" ")
    }

    /// Factors and offsets of a level, where each coordinate follows from its own axis.
    fn diagonal(level: &Level) -> Option<(Vec<f64>, Vec<f64>)> {
        let map = level.map.as_ref()?;
        Some((0..map.outputs()).map(|at| (map.factor(at, at), map.offset(at))).unzip())
    }

    #[test]
    fn versions_0_1_to_0_3_tell_axes_at_most() {
        let image = |version: &str| json!({ "version": version, "name": "example", "datasets": [{ "path": "0" }, { "path": "1" }] });
        for version in ["0.1", "0.2"] {
            let found = read(&json!({ "multiscales": [image(version)] })).unwrap();
            assert_eq!((names(&found), found.levels.len(), diagonal(&found.levels[1])), ("t c z y x".into(), 2, None));
            assert_eq!(found.notes, []);
        }
        let mut image = image("0.3");
        image["axes"] = json!(["z", "y", "x"]);
        let found = read(&json!({ "multiscales": [image] })).unwrap();
        assert_eq!((names(&found), found.levels[1].path.as_str()), ("z y x".into(), "1"));
    }

    /// The example of 0.4: the image's own scale follows those of the levels.
    #[test]
    fn the_image_s_transformations_follow_the_levels_in_0_4_and_0_5() {
        let space = |name: &str| json!({ "name": name, "type": "space", "unit": "micrometer" });
        let level = |path: &str, scale: f64| {
            json!({ "path": path, "coordinateTransformations": [
                { "type": "scale", "scale": [1.0, 1.0, scale, scale, scale] },
                { "type": "translation", "translation": [0, 0, scale / 2.0, 0, 0] }
            ] })
        };
        let image = json!({
            "version": "0.4", "name": "example",
            "axes": [{ "name": "t", "type": "time", "unit": "millisecond" }, { "name": "c", "type": "channel" }, space("z"), space("y"), space("x")],
            "datasets": [level("0", 0.5), level("1", 1.0)],
            "coordinateTransformations": [{ "type": "scale", "scale": [0.1, 1.0, 2.0, 1.0, 1.0] }],
        });
        for document in [json!({ "multiscales": [image] }), json!({ "version": "0.5", "multiscales": [image] })] {
            let found = read(&document).unwrap();
            assert_eq!(
                diagonal(&found.levels[0]).unwrap(),
                (vec![0.1, 1.0, 1.0, 0.5, 0.5], vec![0.0, 0.0, 0.5, 0.0, 0.0])
            );
            assert_eq!(
                diagonal(&found.levels[1]).unwrap(),
                (vec![0.1, 1.0, 2.0, 1.0, 1.0], vec![0.0, 0.0, 1.0, 0.0, 0.0])
            );
            assert_eq!((found.axes[0].unit.as_deref(), found.notes.len()), (Some("millisecond"), 0));
        }
    }

    fn system(name: &str, unit: &str) -> Value {
        let axis = |name: &str| json!({ "name": name, "type": "space", "unit": unit });
        json!({ "name": name, "axes": [axis("y"), axis("x")] })
    }

    /// The levels' system is not the first one.
    fn image_0_6() -> Value {
        json!({ "version": "0.6", "multiscales": [{
            "coordinateSystems": [system("physical", "millimeter"), system("intrinsic", "micrometer")],
            "datasets": [
                { "path": "s0", "coordinateTransformations": [
                    { "type": "scale", "scale": [3, 2], "input": { "path": "s0" }, "output": { "name": "intrinsic" } }
                ] },
                { "path": "s1", "coordinateTransformations": [
                    { "type": "sequence", "input": { "path": "s1" }, "output": { "name": "intrinsic" }, "transformations": [
                        { "type": "scale", "scale": [6, 4] }, { "type": "translation", "translation": [1.5, 1] }
                    ] }
                ] }
            ],
            "coordinateTransformations": [
                { "type": "scale", "scale": [10, 10], "input": { "name": "intrinsic" }, "output": { "name": "physical" } },
                { "type": "identity", "input": { "name": "intrinsic" }, "output": { "name": "a", "path": "labels/a" } }
            ]
        }] })
    }

    #[test]
    fn the_system_of_the_levels_is_the_image_s_in_0_6() {
        let mut document = image_0_6();
        for version in ["0.6", "0.6rc0", "0.6.dev4"] {
            document["version"] = json!(version);
            let found = read(&document).unwrap();
            assert_eq!((found.axes[0].unit.as_deref(), &found.notes), (Some("micrometer"), &Vec::new()));
            assert_eq!(diagonal(&found.levels[0]).unwrap(), (vec![3.0, 2.0], vec![0.0, 0.0]));
            assert_eq!(diagonal(&found.levels[1]).unwrap(), (vec![6.0, 4.0], vec![1.5, 1.0]));
            assert_eq!(found.systems.len(), 1);
            assert_eq!((found.systems[0].name.as_str(), found.systems[0].map.factor(1, 1)), ("physical", 10.0));
        }
        document["version"] = json!("0.9.dev1");
        assert!(said(&read(&document).unwrap().notes).contains("Version \"0.9.dev1\" of OME-Zarr is not known"));
        // Drafts name systems by texts.
        let image = &mut document["multiscales"][0];
        for dataset in 0..2 {
            image["datasets"][dataset]["coordinateTransformations"][0]["output"] = json!("intrinsic");
        }
        image["coordinateTransformations"][0]["input"] = json!("intrinsic");
        image["coordinateTransformations"][0]["output"] = json!("physical");
        assert_eq!(read(&document).unwrap().systems.len(), 1);
    }

    #[test]
    fn what_cannot_be_read_is_told_and_damage_has_its_place() {
        let changed = |change: &dyn Fn(&mut Value)| {
            let mut document = image_0_6();
            change(&mut document["multiscales"][0]);
            read(&document)
        };
        let found = changed(&|image| {
            image["coordinateTransformations"][0] = json!({ "type": "displacements", "path": "d", "input": { "name": "intrinsic" }, "output": { "name": "physical" } });
        });
        assert!(
            said(&found.unwrap().notes)
                .contains("coordinateTransformations[0] (displacements in an array) is left out")
        );
        for (end, value) in [
            ("input", json!({ "name": "other" })),
            ("input", json!({ "name": "physical" })),
            ("output", Value::Null),
            ("output", json!({ "name": "intrinsic" })),
        ] {
            let found = changed(&|image| image["coordinateTransformations"][0][end] = value.clone()).unwrap();
            let notes = said(&found.notes);
            let is_told = notes.contains("(not between intrinsic and another system) is left out");
            assert!(is_told && found.systems.is_empty(), "{notes}");
        }
        let found = changed(&|image| {
            image["coordinateTransformations"][0] = json!({ "type": "affine", "affine": [[1, 0, 0]], "input": { "name": "intrinsic" }, "output": { "name": "physical" } });
        });
        assert!(said(&found.unwrap().notes).contains("(to 1 coordinates, not 2) is left out"));
        let found = changed(&|image| image["datasets"][0]["coordinateTransformations"][0]["type"] = json!("warp"));
        assert!(found.unwrap().levels[0].map.is_none());
        for (change, expected) in [
            (
                &(|image: &mut Value| image["datasets"][1]["path"] = json!(1)) as &dyn Fn(&mut Value),
                "attributes.ome.multiscales[0].datasets[1].path: expected the path of an array, found 1",
            ),
            (&|image| image["datasets"] = json!([]), "multiscales[0].datasets: expected 1 to 64 levels, found []"),
            (
                &|image| image["datasets"] = Value::Null,
                "multiscales[0].datasets: is missing, expected a list of levels",
            ),
            (
                &|image| image["datasets"][1]["coordinateTransformations"][0]["output"] = json!("physical"),
                "datasets[1].coordinateTransformations[0].output: expected intrinsic, the system of the levels before",
            ),
            (
                &|image| image["coordinateSystems"][1]["name"] = json!("other"),
                "datasets[0].coordinateTransformations[0].output: expected the name of one of the coordinateSystems",
            ),
            (
                &|image| image["datasets"][0]["coordinateTransformations"][0]["scale"] = json!([1, 2, 3]),
                "datasets[0].coordinateTransformations[0].scale: expected 2 numbers, one for each axis, found [1,2,3]",
            ),
            (&|image| image["coordinateSystems"] = json!([]), "expected the name of one of the coordinateSystems"),
        ] {
            let message = changed(change).unwrap_err();
            assert!(message.starts_with("zarr.json: ") && message.contains(expected), "{message}");
        }
        // In 0.4 and 0.5.
        let read_levels = |transforms: Value| {
            let image =
                json!({ "axes": ["y", "x"], "datasets": [{ "path": "0", "coordinateTransformations": transforms }] });
            read(&json!({ "multiscales": [image] })).unwrap()
        };
        let scale = json!({ "type": "scale", "scale": [2, 3] });
        let found = read_levels(json!([scale, scale]));
        assert!(said(&found.notes).contains("coordinateTransformations has several scales, which are multiplied"));
        assert_eq!(diagonal(&found.levels[0]).unwrap().0, [4.0, 9.0]);
        let found = read_levels(json!([{ "type": "translation", "translation": [2, 3] }]));
        assert!(said(&found.notes).contains("has no scale, which is taken as 1"));
        assert!(read_levels(json!([])).levels[0].map.is_none());
        let image = json!({ "datasets": [{ "path": "0", "coordinateTransformations": [scale] }] });
        let message = read(&json!({ "multiscales": [image] })).unwrap_err();
        assert!(message.contains("multiscales[0].axes: is missing, expected a list of axes"), "{message}");
        assert!(read(&json!({ "multiscales": [] })).unwrap_err().contains("multiscales: expected at least one image"));
        let several = json!({ "multiscales": [{ "datasets": [{ "path": "0" }] }, { "name": "b", "datasets": [{ "path": "1" }] }] });
        assert!(
            said(&read(&several).unwrap().notes)
                .contains("The first of 2 multiscales is read; the others are left out: b.")
        );
        assert!(Multiscale::of(&Ome::in_test(&json!({ "plate": {} }))).unwrap().is_none());
        let image = |path: &str| json!({ "axes": ["z", "y", "x"], "datasets": [{ "path": path }] });
        let both = json!({ "multiscales": [image("0"), image("other")] });
        let found = |path: &str| Multiscale::with_level(&Ome::in_test(&both), &|other| other == path).unwrap();
        assert!(found("0").is_some_and(|(image, level)| level == 0 && image.levels[0].path == "0"));
        assert!(found("other").is_some_and(|(image, level)| level == 0 && image.levels[0].path == "other"));
        assert!(found("missing").is_none());
    }
}
