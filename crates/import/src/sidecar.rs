//! Short texts beside a raw file that describe it. Costs their bytes, up to a limit.

use crate::error::{ImportError, Result};
use crate::files::first_bytes;
use std::path::Path;
use std::str::FromStr;

/// Longest text read: thousands of bands with names and wavelengths take a tenth.
const LONGEST: usize = 4 << 20;

/// Reads a text, called `what` in messages. Bytes that are no UTF-8 only occur in names.
pub(crate) fn text_of(path: &Path, what: &str) -> Result<String> {
    let bytes = first_bytes(path, LONGEST + 1)?;
    if bytes.len() > LONGEST {
        let problem = format!("is longer than {LONGEST} bytes, more than any {what}; name the text, not the raw file");
        return Err(ImportError::invalid(path, problem));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    Ok(String::from_utf8_lossy(bytes).into_owned())
}

/// The numbers of a text between blanks and commas; `None` if one of them is no number.
pub(crate) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    let parts = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|part| !part.is_empty());
    parts.map(|part| part.parse().ok()).collect()
}

/// Checks that the raw file is a regular one: reading a pipe would wait.
pub(crate) fn check_raw(header: &Path, raw: &Path) -> Result<()> {
    match std::fs::metadata(raw) {
        Ok(data) if data.is_file() => Ok(()),
        Ok(_) => Err(ImportError::invalid(header, format!("its raw file {} is not a file", raw.display()))),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let problem = format!("its raw file {} is missing: put it beside the text", raw.display());
            Err(ImportError::invalid(header, problem))
        }
        Err(error) => Err(ImportError::io(raw)(error)),
    }
}
