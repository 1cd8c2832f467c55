//! A display that nobody sees (Xvfb), windows of the command on it, and a hand (xdotool).

use crate::{command, leave_out};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A display without a screen that anybody sees.
pub struct Display {
    server: Child,
    name: String,
}

impl Display {
    /// Starts a display of 1400 by 900 pixels; `None`, and said so, where there is no such server.
    pub fn start() -> Option<Self> {
        Self::start_with(&["-screen", "0", "1400x900x24"])
    }

    /// Starts a display that is like this, in the server's words; `None`, and said so, where there is no such server.
    pub fn start_with(arguments: &[&str]) -> Option<Self> {
        let asked = Command::new("Xvfb")
            // Where windows come one after another, it does not begin anew between them: clients would find no server.
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

    /// `brickyard view` on this display, in a folder that is also the user's home.
    pub fn view(&self, folder: &Path, arguments: &[&str]) -> Command {
        let mut view = command();
        view.arg("view").args(arguments).current_dir(folder).env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        // Where it is set, EGL asks for more, and a server without the extension XFIXES aborts of that.
        view.env_remove("XDG_RUNTIME_DIR");
        for (name, inner) in [("HOME", ""), ("XDG_STATE_HOME", "state"), ("XDG_CACHE_HOME", "cache")] {
            view.env(name, folder.join(inner));
        }
        view
    }

    /// Sends input, as xdotool has it in words.
    pub fn input(&self, words: &str) {
        let sent = Command::new("xdotool").args(words.split(' ')).env("DISPLAY", &self.name).output();
        let sent = sent.expect("xdotool is there");
        assert!(sent.status.success(), "xdotool {words}: {}", String::from_utf8_lossy(&sent.stderr));
    }

    /// Ends the server, as if the screen had been pulled out.
    pub fn end(&mut self) {
        // One that is asked to end takes its lock with it, which would confuse the next server; it may be gone.
        let _ = Command::new("kill").arg(self.server.id().to_string()).stderr(Stdio::null()).status();
        let _ = self.server.wait();
    }

    /// Waits for a window of the command, and turns the keyboard to it.
    pub fn focus(&self) {
        self.input("search --sync --onlyvisible --name brickyard windowfocus --sync");
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.end();
    }
}
