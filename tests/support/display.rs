//! An invisible display (Xvfb), the command's windows on it, and input to them (xdotool).

use crate::{command, leave_out};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A display server without a screen.
pub struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// Starts a display of 1400 by 900 pixels; `None`, with a message, if there is no Xvfb.
    pub fn start() -> Option<Self> {
        Self::start_with(&["-screen", "0", "1400x900x24"])
    }

    /// Starts a display with these server arguments; `None`, with a message, if there is no Xvfb.
    pub fn start_with(arguments: &[&str]) -> Option<Self> {
        let asked = Command::new("Xvfb")
            // Without a reset between consecutive windows, in which clients would find no server.
            .args(["-displayfd", "1", "-nolisten", "tcp", "-noreset"])
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut server) = asked else {
            leave_out("display", "there is no Xvfb, so no window was opened");
            return None;
        };
        let mut number = String::new();
        let output = server.stdout.take().expect("piped");
        BufReader::new(output).read_line(&mut number).expect("the display's number");
        Some(Self { server, name: format!(":{}", number.trim()) })
    }

    /// `brickyard view` on this display, with `folder` as working folder and home.
    pub fn view(&self, folder: &Path, arguments: &[&str]) -> Command {
        let mut view = command();
        view.arg("view").args(arguments).current_dir(folder).env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        // If it is set, EGL requests more, and a server without the extension XFIXES aborts.
        view.env_remove("XDG_RUNTIME_DIR");
        for (name, inner) in [("HOME", ""), ("XDG_STATE_HOME", "state"), ("XDG_CACHE_HOME", "cache")] {
            view.env(name, folder.join(inner));
        }
        view
    }

    /// Sends input, in the words of xdotool.
    pub fn input(&self, words: &str) {
        let sent = Command::new("xdotool").args(words.split(' ')).env("DISPLAY", &self.name).output();
        let sent = sent.expect("xdotool is there");
        assert!(sent.status.success(), "xdotool {words}: {}", String::from_utf8_lossy(&sent.stderr));
    }

    /// Ends the server, as if the screen had been unplugged.
    pub fn end(&mut self) {
        // By a signal, on which the server removes its lock, which would confuse the next one; it may already be gone.
        let _ = Command::new("kill").arg(self.server.id().to_string()).stderr(Stdio::null()).status();
        let _ = self.server.wait();
    }

    /// Waits for a window of the command, and focuses the keyboard on it.
    pub fn focus(&self) {
        self.input("search --sync --onlyvisible --name brickyard windowfocus --sync");
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.end();
    }
}
