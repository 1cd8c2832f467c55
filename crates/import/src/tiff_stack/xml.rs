//! XML of any length, read as a stream of tags and texts of bounded length.

use quick_xml::Reader;
use quick_xml::events::BytesStart;
use std::borrow::Cow;
use std::io::{BufRead, Read};

/// Most bytes of a text, or of a tag with its attributes.
const LONGEST_PIECE: u64 = 16 << 20;
/// Most bytes of a UUID or a file's name.
pub(super) const LONGEST_NAME: usize = 1024;

/// Creates a reader of a text. Call [`next_piece`] before reading each event.
pub(super) fn reader<R: BufRead>(text: R) -> Reader<Pieces<R>> {
    let mut xml = Reader::from_reader(Pieces { text, left: LONGEST_PIECE });
    // An empty element then starts and ends like any other.
    xml.config_mut().expand_empty_elements = true;
    xml
}

/// Allows the next tag or text its full length.
pub(super) fn next_piece<R>(xml: &mut Reader<Pieces<R>>, piece: &mut Vec<u8>) {
    piece.clear();
    xml.get_mut().left = LONGEST_PIECE;
}

/// Why a text cannot be followed.
#[derive(Debug)]
pub(super) enum Failure {
    Disk(std::io::Error),
    /// A problem of its content, in words.
    Meaning(String),
}

impl From<quick_xml::Error> for Failure {
    fn from(error: quick_xml::Error) -> Self {
        match error {
            quick_xml::Error::Io(error) if error.kind() != std::io::ErrorKind::FileTooLarge => {
                Self::Disk(std::io::Error::new(error.kind(), error.to_string()))
            }
            error => Self::Meaning(format!("is not well-formed ({error})")),
        }
    }
}

pub(super) fn meaning<T>(problem: impl Into<String>) -> Result<T, Failure> {
    Err(Failure::Meaning(problem.into()))
}

/// A text with a limit on the bytes read before the next piece begins.
pub(super) struct Pieces<R> {
    text: R,
    left: u64,
}

impl<R: BufRead> Read for Pieces<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}

impl<R: BufRead> BufRead for Pieces<R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        if self.left == 0 {
            let problem = format!("a text or tag of more than {} MiB", LONGEST_PIECE >> 20);
            return Err(std::io::Error::new(std::io::ErrorKind::FileTooLarge, problem));
        }
        let bytes = self.text.fill_buf()?;
        Ok(&bytes[..bytes.len().min(usize::try_from(self.left).unwrap_or(usize::MAX))])
    }

    fn consume(&mut self, count: usize) {
        self.left = self.left.saturating_sub(count as u64);
        self.text.consume(count);
    }
}

/// A whole number in an attribute.
pub(super) fn number<T: std::str::FromStr>(tag: &BytesStart, name: &str) -> Result<Option<T>, Failure> {
    let Some(text) = attribute(tag, name)? else { return Ok(None) };
    match text.trim().parse() {
        Ok(number) => Ok(Some(number)),
        Err(_) => meaning(format!(
            "has {} whose {name} is '{}', expected a whole number",
            decoded(tag.local_name().as_ref()),
            text.chars().take(40).collect::<String>()
        )),
    }
}

pub(super) fn attribute(tag: &BytesStart, name: &str) -> Result<Option<String>, Failure> {
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(quick_xml::Error::from)?;
        if attribute.key.as_ref() == name.as_bytes() {
            let text = decoded(&attribute.value);
            let text = quick_xml::escape::unescape(&text).map_err(quick_xml::Error::from)?.into_owned();
            if text.len() > LONGEST_NAME {
                return meaning(format!("has a {name} of more than 1,024 characters"));
            }
            return Ok(Some(text));
        }
    }
    Ok(None)
}

/// Decodes UTF-8, or else Latin-1, whose bytes are the first 256 code points.
pub(super) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&b| b as char).collect(),
    }
}
