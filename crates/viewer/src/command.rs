//! Commands: everything that a hand does in the window, as words. A button, a key and a line of a script come down to the same command, so a script
//! plays what a user does.

use brickyard::volume::{Mode, Viewpoint};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Something to do in the window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Command {
    /// Turn the view around its target, in degrees: the volume goes to the right, and over the top.
    Orbit { right_deg: f64, up_deg: f64 },
    /// Roll the view clockwise, in degrees.
    Roll { angle_deg: f64 },
    /// Move the volume right and up, by parts of the picture's height.
    Pan { right: f64, up: f64 },
    /// Come nearer by a factor to what is in a place of the picture, in parts of its width and height from the upper left corner; `None` is its middle.
    Zoom { factor: f64, at: Option<[f64; 2]> },
    /// Look from a side at everything.
    View(Viewpoint),
    /// Look at everything, from the direction of now.
    Fit,
    /// Parallel rays, or perspective.
    Parallel(bool),
    /// How samples become pixels.
    Mode(Mode),
    /// Whether fog is lit.
    Lit(bool),
    /// The time step of all layers.
    Time(u32),
    /// What a layer looks like.
    Layer { layer: usize, look: Look },
    /// Whether box, scale bar and axes are drawn over the picture.
    Overlays(bool),
    /// Take back the last edit.
    Undo,
    /// Make the edit again that was taken back.
    Redo,
    /// Write the scene as `render --scene` takes it.
    SaveScene(PathBuf),
    /// Write the volume's picture as it is shown, with its scene.
    SavePicture(PathBuf),
    /// Write what the window shows, panels and all.
    Screenshot(PathBuf),
    /// Close the window.
    Quit,
}

/// A property of a layer's look.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Look {
    /// Whether the layer is shown.
    Visible(bool),
    /// The least and the greatest value of its window; `None` is the store's own.
    Window(Option<[f64; 2]>),
    /// The preset of its transfer function; `None` is a gray ramp.
    Colors(Option<String>),
    /// The power by which colours and opacities are bent.
    Gamma(f64),
    /// The factor of opacities, in 0..=1.
    Opacity(f64),
    /// The value of its first isosurface.
    Isovalue(f64),
}

impl Command {
    /// The kind of edit of the scene that the command makes: edits of one kind that follow each other are undone together. `None` edits nothing
    /// that can be undone.
    pub(crate) fn edits(&self) -> Option<String> {
        match self {
            Self::Mode(_) | Self::Lit(_) | Self::Time(_) => Some(self.words()[0].clone()),
            Self::Layer { layer, look } => Some(format!("{} {layer}", look.name())),
            _ => None,
        }
    }

    /// The command's words; the first one is its name.
    fn words(&self) -> Vec<String> {
        let name = |name: &str| vec![name.to_string()];
        let with = |name: &str, words: &[String]| [&[name.to_string()], words].concat();
        let numbers = |name, numbers: &[f64]| with(name, &numbers.iter().map(f64::to_string).collect::<Vec<_>>());
        let path = |name, path: &PathBuf| with(name, &[path.display().to_string()]);
        match self {
            Self::Orbit { right_deg, up_deg } => numbers("orbit", &[*right_deg, *up_deg]),
            Self::Roll { angle_deg } => numbers("roll", &[*angle_deg]),
            Self::Pan { right, up } => numbers("pan", &[*right, *up]),
            Self::Zoom { factor, at } => {
                numbers("zoom", &[*factor].into_iter().chain(at.iter().flatten().copied()).collect::<Vec<_>>())
            }
            Self::View(view) => {
                let known = Viewpoint::all().find(|(_, known)| known == view);
                with("view", &[known.map_or_else(String::new, |(name, _)| name.to_string())])
            }
            Self::Fit => name("fit"),
            Self::Parallel(is_parallel) => with("parallel", &[on_or_off(*is_parallel)]),
            Self::Mode(mode) => with("mode", &[mode_name(*mode).to_string()]),
            Self::Lit(is_lit) => with("lit", &[on_or_off(*is_lit)]),
            Self::Time(time) => with("time", &[time.to_string()]),
            Self::Layer { layer, look } => {
                let mut words = with(look.name(), &[layer.to_string()]);
                words.extend(look.values());
                words
            }
            Self::Overlays(is_on) => with("overlays", &[on_or_off(*is_on)]),
            Self::Undo => name("undo"),
            Self::Redo => name("redo"),
            Self::SaveScene(file) => path("save-scene", file),
            Self::SavePicture(file) => path("save-picture", file),
            Self::Screenshot(file) => path("screenshot", file),
            Self::Quit => name("quit"),
        }
    }
}

impl Look {
    fn name(&self) -> &'static str {
        match self {
            Self::Visible(_) => "visible",
            Self::Window(_) => "window",
            Self::Colors(_) => "colors",
            Self::Gamma(_) => "gamma",
            Self::Opacity(_) => "opacity",
            Self::Isovalue(_) => "isovalue",
        }
    }

    fn values(&self) -> Vec<String> {
        match self {
            Self::Visible(is_visible) => vec![on_or_off(*is_visible)],
            Self::Window(None) => vec!["auto".into()],
            Self::Window(Some(window)) => window.map(|value| value.to_string()).into(),
            Self::Colors(preset) => vec![preset.clone().unwrap_or_else(|| "gray".into())],
            Self::Gamma(number) | Self::Opacity(number) | Self::Isovalue(number) => vec![number.to_string()],
        }
    }
}

/// A mode's name, as `render --mode` has it.
pub(crate) fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Dvr => "dvr",
        Mode::Mip => "mip",
        Mode::MinIp => "minip",
        Mode::Average => "average",
        Mode::Isosurface => "isosurface",
    }
}

fn on_or_off(is_on: bool) -> String {
    if is_on { "on" } else { "off" }.into()
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words().join(" "))
    }
}

/// All commands with the forms of what follows their names.
const FORMS: [(&str, &str); 22] = [
    ("orbit", "DEGREES_RIGHT DEGREES_UP"),
    ("roll", "DEGREES"),
    ("pan", "RIGHT UP, in parts of the picture's height"),
    ("zoom", "FACTOR, or FACTOR RIGHT DOWN, in parts of the picture's width and height"),
    ("view", "SIDE"),
    ("fit", ""),
    ("parallel", "on|off"),
    ("mode", "dvr|mip|minip|average|isosurface"),
    ("lit", "on|off"),
    ("time", "STEP"),
    ("visible", "LAYER on|off"),
    ("window", "LAYER LEAST GREATEST, or LAYER auto"),
    ("colors", "LAYER PRESET"),
    ("gamma", "LAYER NUMBER"),
    ("opacity", "LAYER NUMBER"),
    ("isovalue", "LAYER VALUE"),
    ("overlays", "on|off"),
    ("undo", ""),
    ("redo", ""),
    ("save-scene", "FILE"),
    ("save-picture", "FILE"),
    ("screenshot", "FILE"),
];

impl FromStr for Command {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = text.trim().split_once(' ').unwrap_or((text.trim(), ""));
        if (name, rest) == ("quit", "") {
            return Ok(Self::Quit);
        }
        let Some((_, form)) = FORMS.iter().find(|(known, _)| *known == name) else {
            let names: Vec<_> = FORMS.iter().map(|(name, _)| *name).chain(["quit"]).collect();
            let near = brickyard::volume::near_name::hint(name, names.iter().copied());
            return Err(format!("no command '{name}'{near}: expected one of {}", names.join(", ")));
        };
        if name == "view" {
            return Viewpoint::from_name(rest.trim()).map(Self::View);
        }
        let words: Vec<&str> = rest.split_whitespace().collect();
        parsed(name, &words, rest.trim()).ok_or_else(|| format!("'{text}': expected {name} {form}"))
    }
}

/// A command by its name and what follows; `None` if that is malformed.
fn parsed(name: &str, words: &[&str], rest: &str) -> Option<Command> {
    let number = |text: &str| text.parse().ok().filter(|number: &f64| number.is_finite());
    let switch = |text: &str| match text {
        "on" => Some(true),
        "off" => Some(false),
        _ => None,
    };
    let file = || (!rest.is_empty()).then(|| PathBuf::from(rest));
    Some(match (name, words) {
        ("orbit", [right, up]) => Command::Orbit { right_deg: number(right)?, up_deg: number(up)? },
        ("roll", [angle]) => Command::Roll { angle_deg: number(angle)? },
        ("pan", [right, up]) => Command::Pan { right: number(right)?, up: number(up)? },
        ("zoom", [factor, at @ ..]) => {
            let at = match at {
                [] => None,
                [right, down] => Some([number(right)?, number(down)?]),
                _ => return None,
            };
            Command::Zoom { factor: number(factor).filter(|&factor| factor > 0.0)?, at }
        }
        ("fit", []) => Command::Fit,
        ("parallel", [is_parallel]) => Command::Parallel(switch(is_parallel)?),
        ("mode", [mode]) => Command::Mode(Mode::ALL.into_iter().find(|known| mode_name(*known) == *mode)?),
        ("lit", [is_lit]) => Command::Lit(switch(is_lit)?),
        ("time", [time]) => Command::Time(time.parse().ok()?),
        ("overlays", [is_on]) => Command::Overlays(switch(is_on)?),
        ("undo", []) => Command::Undo,
        ("redo", []) => Command::Redo,
        ("save-scene", _) => Command::SaveScene(file()?),
        ("save-picture", _) => Command::SavePicture(file()?),
        ("screenshot", _) => Command::Screenshot(file()?),
        (_, [layer, values @ ..]) => {
            let look = match (name, values) {
                ("visible", [is_visible]) => Look::Visible(switch(is_visible)?),
                ("window", ["auto"]) => Look::Window(None),
                ("window", [low, high]) => Look::Window(Some([number(low)?, number(high)?])),
                ("colors", ["gray"]) => Look::Colors(None),
                ("colors", [preset]) => Look::Colors(Some(preset.to_string())),
                ("gamma", [gamma]) => Look::Gamma(number(gamma).filter(|&gamma| gamma > 0.0)?),
                ("opacity", [opacity]) => Look::Opacity(number(opacity).filter(|part| (0.0..=1.0).contains(part))?),
                ("isovalue", [value]) => Look::Isovalue(number(value)?),
                _ => return None,
            };
            Command::Layer { layer: layer.parse().ok()?, look }
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn number() -> impl Strategy<Value = f64> {
        prop_oneof![Just(0.0), -1e6..1e6, Just(1e-7), Just(0.1)]
    }

    fn command() -> impl Strategy<Value = Command> {
        let viewpoints: Vec<_> = Viewpoint::all().map(|(_, viewpoint)| viewpoint).collect();
        let look = prop_oneof![
            any::<bool>().prop_map(Look::Visible),
            prop::option::of([number(), number()]).prop_map(Look::Window),
            prop::option::of("(viridis|fire)").prop_map(Look::Colors),
            (0.01..9.0).prop_map(Look::Gamma),
            (0.0..=1.0).prop_map(Look::Opacity),
            number().prop_map(Look::Isovalue),
        ];
        let file = "[a-z]{1,5}( [a-z]{1,3})?\\.png".prop_map(PathBuf::from);
        prop_oneof![
            (number(), number()).prop_map(|(right_deg, up_deg)| Command::Orbit { right_deg, up_deg }),
            number().prop_map(|angle_deg| Command::Roll { angle_deg }),
            (number(), number()).prop_map(|(right, up)| Command::Pan { right, up }),
            (0.01..99.0, prop::option::of([number(), number()])).prop_map(|(factor, at)| Command::Zoom { factor, at }),
            prop::sample::select(viewpoints).prop_map(Command::View),
            prop::sample::select(vec![Command::Fit, Command::Undo, Command::Redo, Command::Quit]),
            any::<bool>().prop_map(Command::Parallel),
            any::<bool>().prop_map(Command::Lit),
            any::<bool>().prop_map(Command::Overlays),
            prop::sample::select(Mode::ALL.to_vec()).prop_map(Command::Mode),
            any::<u32>().prop_map(Command::Time),
            (0usize..40, look).prop_map(|(layer, look)| Command::Layer { layer, look }),
            file.clone().prop_map(Command::SaveScene),
            file.clone().prop_map(Command::SavePicture),
            file.prop_map(Command::Screenshot),
        ]
    }

    proptest! {
        #[test]
        fn a_command_is_read_as_it_was_written(command in command()) {
            prop_assert_eq!(command.to_string().parse(), Ok(command));
        }

        #[test]
        fn no_line_is_a_panic(line in "[a-z]{0,8}( [-a-z0-9.]{0,5}){0,3}") {
            let _ = line.parse::<Command>();
        }
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
            "window 0 1",
            "opacity 0 2",
            "visible on",
            "screenshot",
            "mode fog",
            "",
        ] {
            assert!(bad.parse::<Command>().is_err(), "{bad}");
        }
    }
}
