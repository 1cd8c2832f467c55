//! Tests without their requirements on this machine: skipped with a message, or failed if these are mandatory.

/// Requirements of tests: name in `BRICKYARD_REQUIRE`, and remedy.
const CURES: [(&str, &str); 6] = [
    ("gpu", "a graphics adapter: run `tools/setup`, which installs a software one (mesa-vulkan-drivers, libvulkan1)"),
    ("python", "the independent readers: run `tools/setup python`, or set BRICKYARD_PYTHON to a Python that has them"),
    (
        "display",
        "a display that nobody sees: run `tools/setup display`, which installs Xvfb, xdotool and what windows load",
    ),
    ("mount", "a file system of its own: run as root, or where user namespaces may mount"),
    ("ffmpeg", "the program ffmpeg in PATH, with libx264"),
    ("permissions", "a user without rights: as root, setpriv (of util-linux); else any"),
];

/// Reports on standard error a test, or a part of it, skipped for lack of `name`: `gpu`, `python`, `display`, `mount`,
/// `ffmpeg` or `permissions`.
///
/// # Panics
/// If the name is none of these, or is in the environment variable `BRICKYARD_REQUIRE` (names between commas). `tools/test`
/// requires a GPU, Python and a display unless the variable is set.
pub fn leave_out(name: &str, reason: impl std::fmt::Display) {
    let cure = CURES.iter().find(|(known, _)| *known == name).map(|(_, cure)| *cure).expect("a name of the list");
    let required = std::env::var("BRICKYARD_REQUIRE").unwrap_or_default();
    assert!(
        !required.split(',').any(|required| required.trim() == name),
        "BRICKYARD_REQUIRE={required}: this test needs {cure}; {reason}"
    );
    eprintln!("SKIPPED for want of {cure}; {reason}");
}
