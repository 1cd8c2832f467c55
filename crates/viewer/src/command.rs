//! Commands: every action in the window, as words. A button, a key and a script's line give the same command, so a script replays a user's actions.

use crate::fields::differences;
use crate::marks::Marks;
use crate::panels::description::Description;
use crate::panels::edit_form::MetadataEdit;
use crate::panels::export_form::ExportForm;
use crate::panels::mesh_form::MeshForm;
use brickyard::volume::Viewpoint;
use glam::DVec3;
use serde_json::{Map, Value};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// An action in the window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Command {
    /// Turn the view around a world point, in degrees: the volume goes to the right, and over the top. `None` is the camera's target.
    Orbit { right_deg: f64, up_deg: f64, about: Option<DVec3> },
    /// Turn the eye, in degrees: to the right, and up.
    Look { right_deg: f64, up_deg: f64 },
    /// Roll the view clockwise, in degrees.
    Roll { angle_deg: f64 },
    /// Move the volume right and up, by parts of the picture's height.
    Pan { right: f64, up: f64 },
    /// Move the eye right, up and forward, by parts of its distance from the volumes.
    Fly { right: f64, up: f64, forward: f64 },
    /// Zoom by a factor towards a place of the picture, in parts of its width and height from the upper left corner; `None` is its middle.
    Zoom { factor: f64, at: Option<[f64; 2]> },
    /// Look at everything from one side.
    View(Viewpoint),
    /// Look at everything, in the current direction.
    Fit,
    /// Look at a world point, in the current direction; the slices meet there.
    Center(DVec3),
    /// Parallel rays, or perspective.
    Parallel(bool),
    /// Show only a box, all of the volumes at first, or everything.
    Clip(bool),
    /// Set fields of the window's document, each by its path: see [`State`](crate::state::State).
    Set(Vec<(String, Value)>),
    /// Click, in points from the window's upper left corner.
    Click([f64; 2]),
    /// Show volumes: stores, or files and folders shown while being packed; or meshes, beside the current volumes.
    Open(Vec<PathBuf>, Placing),
    /// Open or add a file, with a description of missing metadata.
    OpenAs(PathBuf, Description, Placing),
    /// Undo the last edit.
    Undo,
    /// Redo the last undone edit.
    Redo,
    /// Write the window's document, in the form of `render --scene`.
    SaveScene(PathBuf),
    /// Write the volume's picture once it is final, with its scene.
    SavePicture(PathBuf, PictureForm),
    /// Write voxels of the first visible layer within the clip box.
    Export(PathBuf, ExportForm),
    /// Write a surface of the first visible layer within the clip box as triangles.
    Mesh(PathBuf, MeshForm),
    /// Change the metadata of the first visible layer's store.
    Edit(MetadataEdit),
    /// Write the whole window, panels included.
    Screenshot(PathBuf),
    /// Close the window.
    Quit,
    /// Lose the window's device, for tests.
    LoseGpu,
}

/// The place of newly opened volumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Placing {
    /// Instead of the current ones.
    Instead,
    /// Beside them.
    Beside,
}

/// Form of a saved picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PictureForm {
    /// Width and height; `None` is the shown size.
    pub(crate) size_px: Option<(u32, u32)>,
    /// The marks over the picture; `None` is the window's.
    pub(crate) marks: Option<Marks>,
}

impl fmt::Display for PictureForm {
    /// Writes the form's words, each with a space behind it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.size_px.map_or(Ok(()), |(width, height)| write!(f, "{width}x{height} "))?;
        self.marks.map_or(Ok(()), |marks| write!(f, "{OVER}{marks} "))
    }
}

/// Prefix of a picture's marks.
const OVER: &str = "over=";

impl Command {
    /// Sets one field of the window's document.
    pub(crate) fn set(field: &str, value: impl Into<Value>) -> Self {
        Self::Set(vec![(field.to_string(), value.into())])
    }

    /// Turns the view around the camera's target, in degrees.
    pub(crate) fn orbit(right_deg: f64, up_deg: f64) -> Self {
        Self::Orbit { right_deg, up_deg, about: None }
    }

    /// Whether the command, working on files, ends only later.
    pub(crate) fn takes_time(&self) -> bool {
        self.opens() || self.exports() || matches!(self, Self::Edit(_) | Self::SavePicture(..) | Self::Screenshot(_))
    }

    pub(crate) fn exports(&self) -> bool {
        matches!(self, Self::Export(..) | Self::Mesh(..))
    }

    pub(crate) fn opens(&self) -> bool {
        matches!(self, Self::Open(..) | Self::OpenAs(..))
    }

    /// The message for a failure. A file already named by the problem is not repeated.
    pub(crate) fn failure(&self, problem: &str) -> String {
        let is_named = self.file().is_some_and(|file| file.len() > 1 && problem.contains(&file));
        if is_named { problem.into() } else { format!("{self}: {problem}") }
    }

    /// The command's last word, if it is a file or several.
    pub(crate) fn file(&self) -> Option<String> {
        match self {
            Self::Open(paths, _) => Some(listed(paths)),
            Self::OpenAs(path, description, _) => Some(described(path, description)),
            Self::SaveScene(path)
            | Self::SavePicture(path, _)
            | Self::Export(path, _)
            | Self::Mesh(path, _)
            | Self::Screenshot(path) => Some(path.display().to_string()),
            _ => None,
        }
    }
}

fn on_or_off(is_on: bool) -> &'static str {
    if is_on { "on" } else { "off" }
}

/// Paths as words: several as a JSON list.
fn listed(paths: &[PathBuf]) -> String {
    let texts: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
    match &texts[..] {
        [one] => one.clone(),
        _ => Value::from(texts).to_string(),
    }
}

/// A path and its description, as a JSON object of the described properties.
fn described(path: &Path, description: &Description) -> String {
    let [nothing, all] = [&Description::default(), description].map(|it| serde_json::to_value(it).unwrap_or_default());
    let mut object = Map::from_iter(differences(&nothing, &all));
    object.insert("path".into(), path.display().to_string().into());
    Value::Object(object).to_string()
}

/// Parses a path and its description from a JSON object.
fn description(text: &str) -> Option<(PathBuf, Description)> {
    let mut object: Map<String, Value> = serde_json::from_str(text).ok()?;
    let path = PathBuf::from(object.remove("path")?.as_str()?);
    Some((path, serde_json::from_value(object.into()).ok()?))
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = self.file().unwrap_or_default();
        match self {
            Self::Orbit { right_deg, up_deg, about: None } => write!(f, "orbit {right_deg} {up_deg}"),
            Self::Orbit { right_deg, up_deg, about: Some(DVec3 { x, y, z }) } => {
                write!(f, "orbit {right_deg} {up_deg} {x} {y} {z}")
            }
            Self::Look { right_deg, up_deg } => write!(f, "look {right_deg} {up_deg}"),
            Self::Roll { angle_deg } => write!(f, "roll {angle_deg}"),
            Self::Pan { right, up } => write!(f, "pan {right} {up}"),
            Self::Fly { right, up, forward } => write!(f, "fly {right} {up} {forward}"),
            Self::Zoom { factor, at: None } => write!(f, "zoom {factor}"),
            Self::Zoom { factor, at: Some([right, down]) } => write!(f, "zoom {factor} {right} {down}"),
            Self::View(view) => {
                let known = Viewpoint::all().find(|(_, known)| known == view);
                write!(f, "view {}", known.map_or("", |(name, _)| name))
            }
            Self::Fit => f.write_str("fit"),
            Self::Center(DVec3 { x, y, z }) => write!(f, "center {x} {y} {z}"),
            Self::Parallel(is_on) => write!(f, "parallel {}", on_or_off(*is_on)),
            Self::Clip(is_on) => write!(f, "clip {}", on_or_off(*is_on)),
            Self::Set(fields) => match &fields[..] {
                [(field, value)] => write!(f, "set {field} {value}"),
                _ => write!(f, "set {}", Value::Object(Map::from_iter(fields.iter().cloned()))),
            },
            Self::Click([x, y]) => write!(f, "click {x} {y}"),
            Self::Open(_, Placing::Instead) => write!(f, "open {file}"),
            Self::Open(_, Placing::Beside) => write!(f, "add {file}"),
            Self::OpenAs(.., Placing::Instead) => write!(f, "open-as {file}"),
            Self::OpenAs(.., Placing::Beside) => write!(f, "add-as {file}"),
            Self::Undo => f.write_str("undo"),
            Self::Redo => f.write_str("redo"),
            Self::SaveScene(_) => write!(f, "save-scene {file}"),
            Self::SavePicture(_, form) => write!(f, "save-picture {form}{file}"),
            Self::Export(_, form) => write!(f, "export {form}{file}"),
            Self::Mesh(_, form) => write!(f, "mesh {form}{file}"),
            Self::Edit(changes) => write!(f, "edit {}", serde_json::to_value(changes).unwrap_or_default()),
            Self::Screenshot(_) => write!(f, "screenshot {file}"),
            Self::Quit => f.write_str("quit"),
            Self::LoseGpu => f.write_str("lose-gpu"),
        }
    }
}

/// All commands with the forms of their arguments.
const FORMS: [(&str, &str); 27] = [
    ("orbit", "DEGREES_RIGHT DEGREES_UP, optionally with a point of the world, X Y Z"),
    ("look", "DEGREES_RIGHT DEGREES_UP"),
    ("roll", "DEGREES"),
    ("pan", "RIGHT UP, in parts of the picture's height"),
    ("fly", "RIGHT UP FORWARD, in parts of the distance from the volumes"),
    ("zoom", "FACTOR, or FACTOR RIGHT DOWN, in parts of the picture's width and height"),
    ("view", "SIDE"),
    ("fit", ""),
    ("center", "X Y Z"),
    ("parallel", "on|off"),
    ("clip", "on|off"),
    ("set", "FIELD VALUE, or a JSON object of fields and values"),
    ("click", "X Y, in points of the window"),
    ("open", "PATH, or a JSON list of paths"),
    ("add", "PATH, or a JSON list of paths"),
    ("open-as", "a JSON object: path, and properties of the file, such as shape, voxel_type, axes, spacing, labels"),
    ("add-as", "as open-as, to be shown beside the present volumes"),
    ("undo", ""),
    ("redo", ""),
    ("save-scene", "FILE"),
    ("save-picture", "[WIDTHxHEIGHT] [over=none|over=scale_bar,distances,...] FILE"),
    ("export", "[level=N] [channels=0,2] [steps=0-9] [replace=yes] FILE"),
    ("mesh", "[isovalue=V] [label=N|all] [level=N] [smooth=N] [replace=yes] FILE"),
    (
        "edit",
        "a JSON object: name, spacing, origin, unit, value_unit, time_step, time_unit, channel_names, channel_colors",
    ),
    ("screenshot", "FILE"),
    ("quit", ""),
    ("lose-gpu", ""),
];

impl FromStr for Command {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = text.trim().split_once(' ').unwrap_or((text.trim(), ""));
        let Some((_, form)) = FORMS.iter().find(|(known, _)| *known == name) else {
            let near = brickyard::volume::near_name::hint(name, FORMS.iter().map(|(name, _)| *name));
            let names: Vec<_> = FORMS.iter().map(|(name, _)| *name).collect();
            return Err(format!("no command '{name}'{near}: expected one of {}", names.join(", ")));
        };
        if name == "view" {
            return Viewpoint::from_name(rest.trim()).map(Self::View);
        }
        parsed(name, rest.trim()).ok_or_else(|| format!("'{text}': expected {name} {form}"))
    }
}

/// Parses a command; `None` if its arguments are malformed.
fn parsed(name: &str, rest: &str) -> Option<Command> {
    let number = |text: &str| text.parse().ok().filter(|number: &f64| number.is_finite());
    let numbers: Option<Vec<f64>> = rest.split_whitespace().map(number).collect();
    let switch = || match rest {
        "on" => Some(true),
        "off" => Some(false),
        _ => None,
    };
    let placing = if name.starts_with("add") { Placing::Beside } else { Placing::Instead };
    let file = || (!rest.is_empty()).then(|| PathBuf::from(rest));
    Some(match (name, &numbers.unwrap_or_default()[..]) {
        ("orbit", &[right_deg, up_deg]) => Command::orbit(right_deg, up_deg),
        ("orbit", &[right_deg, up_deg, x, y, z]) => {
            Command::Orbit { right_deg, up_deg, about: Some(DVec3::new(x, y, z)) }
        }
        ("look", &[right_deg, up_deg]) => Command::Look { right_deg, up_deg },
        ("roll", &[angle_deg]) => Command::Roll { angle_deg },
        ("pan", &[right, up]) => Command::Pan { right, up },
        ("fly", &[right, up, forward]) => Command::Fly { right, up, forward },
        ("zoom", &[factor]) if factor > 0.0 => Command::Zoom { factor, at: None },
        ("zoom", &[factor, right, down]) if factor > 0.0 => Command::Zoom { factor, at: Some([right, down]) },
        ("center", &[x, y, z]) => Command::Center(DVec3::new(x, y, z)),
        ("click", &[x, y]) => Command::Click([x, y]),
        ("fit", _) if rest.is_empty() => Command::Fit,
        ("undo", _) if rest.is_empty() => Command::Undo,
        ("redo", _) if rest.is_empty() => Command::Redo,
        ("quit", _) if rest.is_empty() => Command::Quit,
        ("lose-gpu", _) if rest.is_empty() => Command::LoseGpu,
        ("parallel", _) => Command::Parallel(switch()?),
        ("clip", _) => Command::Clip(switch()?),
        ("set", _) => Command::Set(fields(rest)?),
        ("open" | "add", _) => Command::Open(paths(rest)?, placing),
        ("open-as" | "add-as", _) => {
            let (path, description) = description(rest)?;
            Command::OpenAs(path, description, placing)
        }
        ("save-scene", _) => Command::SaveScene(file()?),
        ("save-picture", _) => {
            let (form, path) = picture_form(rest)?;
            Command::SavePicture(PathBuf::from(path), form)
        }
        ("export", _) => {
            let (form, path) = ExportForm::read(rest)?;
            Command::Export(PathBuf::from(path), form)
        }
        ("mesh", _) => {
            let (form, path) = MeshForm::read(rest)?;
            Command::Mesh(PathBuf::from(path), form)
        }
        ("edit", _) => Command::Edit(serde_json::from_str(rest).ok()?),
        ("screenshot", _) => Command::Screenshot(file()?),
        _ => return None,
    })
}

/// Parses `FIELD VALUE`, or an object of fields. A value other than JSON is a text.
fn fields(text: &str) -> Option<Vec<(String, Value)>> {
    if text.starts_with('{') {
        let fields: Map<String, Value> = serde_json::from_str(text).ok()?;
        return Some(fields.into_iter().collect());
    }
    let (field, value) = text.split_once(' ')?;
    let value = serde_json::from_str(value.trim()).unwrap_or_else(|_| Value::from(value.trim()));
    Some(vec![(field.to_string(), value)])
}

/// Parses one path, or a JSON list of them.
fn paths(text: &str) -> Option<Vec<PathBuf>> {
    match text {
        "" => None,
        _ if text.starts_with('[') => serde_json::from_str(text).ok(),
        _ => Some(vec![PathBuf::from(text)]),
    }
}

/// Parses a picture's form and file; `None` without a file, or for unknown marks.
fn picture_form(text: &str) -> Option<(PictureForm, &str)> {
    let (mut form, mut rest) = (PictureForm::default(), text);
    while let Some((word, after)) = rest.split_once(' ') {
        match (size_px(word), word.strip_prefix(OVER)) {
            (Some(size_px), _) => form.size_px = Some(size_px),
            (None, Some(marks)) => form.marks = Some(marks.parse().ok()?),
            (None, None) => break,
        }
        rest = after.trim();
    }
    (!rest.is_empty()).then_some((form, rest))
}

/// Parses a picture's width and height, as in `1920x1080`.
pub(crate) fn size_px(text: &str) -> Option<(u32, u32)> {
    let (width, height) = text.split_once('x')?;
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    Some((side(width)?, side(height)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![Just(0.0), -1e6..1e6, Just(1e-7), Just(0.1)]
    }

    fn point() -> impl Strategy<Value = DVec3> {
        [number(), number(), number()].prop_map(DVec3::from_array)
    }

    fn fields() -> impl Strategy<Value = Vec<(String, Value)>> {
        let value = prop_oneof![
            any::<bool>().prop_map(Value::from),
            number().prop_map(Value::from),
            Just(Value::Null),
            "[a-z ]{0,5}".prop_map(Value::from),
            [number(), number()].prop_map(|pair| json!(pair)),
            number().prop_map(|number| json!({"preset": "fire", "of": [number]})),
        ];
        prop::collection::btree_map("[a-z]{1,5}(\\.[0-9a-z]{1,3}){0,2}", value, 1..3)
            .prop_map(|fields| fields.into_iter().collect())
    }

    fn export_form() -> impl Strategy<Value = ExportForm> {
        let form = ("(level=[1-9] )?", "(channels=0,[1-9] )?", "(steps=0-[0-9] )?", "(replace=yes )?");
        form.prop_map(|(a, b, c, d)| ExportForm::read(&format!("{a}{b}{c}{d}x")).unwrap().0)
    }

    fn mesh_form() -> impl Strategy<Value = MeshForm> {
        let form = ("(isovalue=-?[1-9]\\.[0-9]|label=-?[0-9]|label=all)", "( level=[1-9])?", "( smooth=[1-9])?");
        form.prop_map(|(a, b, c)| MeshForm::read(&format!("{a}{b}{c} x")).unwrap().0)
    }

    fn command() -> impl Strategy<Value = Command> {
        let viewpoints: Vec<_> = Viewpoint::all().map(|(_, viewpoint)| viewpoint).collect();
        let plain = vec![Command::Fit, Command::Undo, Command::Redo, Command::Quit, Command::LoseGpu];
        let file = || "[a-z]{1,5}( [a-z]{1,3})?\\.png".prop_map(PathBuf::from);
        let files = || prop::collection::vec(file(), 1..3);
        let turn = || (number(), number());
        let moved = prop_oneof![
            (turn(), prop::option::of(point())).prop_map(|((right_deg, up_deg), about)| Command::Orbit {
                right_deg,
                up_deg,
                about
            }),
            turn().prop_map(|(right_deg, up_deg)| Command::Look { right_deg, up_deg }),
            number().prop_map(|angle_deg| Command::Roll { angle_deg }),
            turn().prop_map(|(right, up)| Command::Pan { right, up }),
            point().prop_map(|by| Command::Fly { right: by.x, up: by.y, forward: by.z }),
            (0.01..99.0, prop::option::of([number(), number()])).prop_map(|(factor, at)| Command::Zoom { factor, at }),
            prop::sample::select(viewpoints).prop_map(Command::View),
            point().prop_map(Command::Center),
            any::<bool>().prop_map(Command::Parallel),
            any::<bool>().prop_map(Command::Clip),
        ];
        prop_oneof![
            moved,
            prop::sample::select(plain),
            fields().prop_map(Command::Set),
            [number(), number()].prop_map(Command::Click),
            files().prop_map(|paths| Command::Open(paths, Placing::Instead)),
            files().prop_map(|paths| Command::Open(paths, Placing::Beside)),
            (file(), any::<bool>()).prop_map(|(file, is_added)| {
                let text = r#"{"shape": [1, 2, 3], "voxel_type": "u16", "axes": "tzyx", "labels": true, "spacing": [1, 2, 0.5]}"#;
                let placing = if is_added { Placing::Beside } else { Placing::Instead };
                Command::OpenAs(file, serde_json::from_str(text).unwrap(), placing)
            }),
            file().prop_map(Command::SaveScene),
            (file(), prop::option::of((1u32..9999, 1u32..9999)), prop::option::of(any::<bool>())).prop_map(
                |(file, size_px, shows)| {
                    let all = crate::marks::Marks::shown(&Default::default());
                    let marks = shows.map(|shows| if shows { all } else { Marks::NONE });
                    Command::SavePicture(file, PictureForm { size_px, marks })
                }
            ),
            (file(), export_form()).prop_map(|(file, form)| Command::Export(file, form)),
            (file(), mesh_form()).prop_map(|(file, form)| Command::Mesh(file, form)),
            (number(), "[a-z ]{0,5}").prop_map(|(number, text)| {
                let edit = json!({"name": text, "spacing": [number, 1, 2], "time_step": number, "channel_names": {"1": text}});
                Command::Edit(serde_json::from_value(edit).unwrap())
            }),
            file().prop_map(Command::Screenshot),
        ]
    }

    proptest! {
        #[test]
        fn a_command_is_read_as_it_was_written(command in command()) {
            prop_assert_eq!(command.to_string().parse(), Ok(command));
        }

        #[test]
        fn no_line_is_a_panic(line in "[a-z]{0,8}( [-a-z0-9.{\\[]{0,5}){0,3}") {
            let _ = line.parse::<Command>();
        }
    }

    #[test]
    fn what_is_no_json_is_a_text() {
        assert_eq!("set mode mip".parse(), Ok(Command::set("mode", "mip")));
        assert_eq!("set layers.0.window [-3, 4.5]".parse(), Ok(Command::set("layers.0.window", json!([-3, 4.5]))));
        assert_eq!("set window.diagnostics true".parse(), Ok(Command::set("window.diagnostics", true)));
    }

    #[test]
    fn what_is_wrong_with_a_line_is_said() {
        let error = |line: &str| line.parse::<Command>().unwrap_err();
        assert!(error("orbt 3 4").contains("did you mean 'orbit'?"));
        assert!(error("orbit 3").contains("expected orbit DEGREES_RIGHT DEGREES_UP"));
        assert!(error("view lft").contains("did you mean 'left'?"));
        for bad in [
            "zoom 0",
            "zoom 2 0.5",
            "zoom inf",
            "set mode",
            "set {1",
            "open",
            "orbit 1 2 3",
            "screenshot",
            "click 3",
            "",
        ] {
            assert!(bad.parse::<Command>().is_err(), "{bad}");
        }
    }
}
