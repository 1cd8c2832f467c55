//! Tags of an XML file, in sequence, without the texts between them: these may be arrays of any length, and are passed
//! over unread. Memory is bounded by the longest tag; the bytes of all tags have a limit.

use crate::error::ImportError;
use quick_xml::events::BytesStart;
use std::io::{BufRead, Error, ErrorKind};
use std::path::Path;

/// Most bytes of one tag or comment, and of all tags together.
const LONGEST_TAG: usize = 1 << 16;
const LONGEST_HEADER: usize = 16 << 20;

/// Why tags cannot be followed.
#[derive(Debug)]
pub(super) enum Failure {
    Disk(Error),
    /// A problem of the content, in words.
    Meaning(String),
}

impl Failure {
    pub(super) fn of(self, path: &Path) -> ImportError {
        match self {
            Self::Disk(error) if error.kind() == ErrorKind::UnexpectedEof => {
                ImportError::invalid(path, "cut short: ends within its header; fetch the file again")
            }
            Self::Disk(error) => ImportError::io(path)(error),
            Self::Meaning(problem) => ImportError::invalid(path, problem),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Disk(error)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Start,
    End,
    /// A start and an end in one.
    Empty,
}

/// A tag with its attributes, unescaped.
#[derive(Debug)]
pub(super) struct Tag {
    pub(super) kind: Kind,
    pub(super) name: String,
    attributes: Vec<(String, String)>,
    /// Place of the first byte after it.
    pub(super) end: u64,
}

impl Tag {
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }

    /// Numbers in an attribute, exactly `N`; `None` if there is no such attribute.
    pub(super) fn numbers<T: std::str::FromStr, const N: usize>(&self, name: &str) -> Result<Option<[T; N]>, Failure> {
        let Some(text) = self.attribute(name) else { return Ok(None) };
        let numbers: Option<Vec<T>> = text.split_ascii_whitespace().map(|word| word.parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| <[T; N]>::try_from(numbers).ok());
        numbers.map(Some).ok_or_else(|| {
            let (tag, text) = (&self.name, shown(text));
            Failure::Meaning(format!("{tag} has {name}=\"{text}\", expected {N} numbers"))
        })
    }

    /// The number in an attribute; `None` if there is no such attribute.
    pub(super) fn number<T: std::str::FromStr>(&self, name: &str) -> Result<Option<T>, Failure> {
        Ok(self.numbers::<T, 1>(name)?.map(|[number]| number))
    }
}

/// The first characters of a foreign text, for messages.
pub(super) fn shown(text: &str) -> String {
    text.chars().take(60).collect()
}

pub(super) struct Tags<R> {
    text: R,
    at: u64,
    bytes: usize,
}

impl<R: BufRead> Tags<R> {
    pub(super) fn new(text: R) -> Self {
        Self { text, at: 0, bytes: 0 }
    }

    /// The next tag; `None` at the text's end.
    pub(super) fn next(&mut self) -> Result<Option<Tag>, Failure> {
        loop {
            self.at += self.text.skip_until(b'<')? as u64;
            if self.text.fill_buf()?.is_empty() {
                return Ok(None);
            }
            let content = self.content()?;
            match content.first() {
                Some(b'?') => {}
                Some(b'!') if content.starts_with(b"!--") => {}
                Some(b'!') => {
                    let word = shown(&String::from_utf8_lossy(&content));
                    return Err(Failure::Meaning(format!("<{word}> in a VTK file is not understood")));
                }
                _ => return self.tag(&content).map(Some),
            }
        }
    }

    /// Reads on to the `>` outside of quotes, or to the end of a comment.
    fn content(&mut self) -> Result<Vec<u8>, Failure> {
        let (mut content, mut quote) = (Vec::new(), None);
        loop {
            let byte = match self.text.fill_buf()?.first() {
                Some(byte) => *byte,
                None => return Err(Error::from(ErrorKind::UnexpectedEof).into()),
            };
            self.text.consume(1);
            self.at += 1;
            let is_comment = content.starts_with(b"!--");
            let ends = if is_comment { content.len() >= 5 && content.ends_with(b"--") } else { quote.is_none() };
            if byte == b'>' && ends {
                return Ok(content);
            }
            match (byte, quote) {
                (b'"' | b'\'', None) if !is_comment => quote = Some(byte),
                (byte, Some(open)) if byte == open => quote = None,
                _ => {}
            }
            content.push(byte);
            self.bytes += 1;
            if content.len() > LONGEST_TAG || self.bytes > LONGEST_HEADER {
                return Err(Failure::Meaning("has a header longer than any valid one; write the file again".into()));
            }
        }
    }

    fn tag(&self, content: &[u8]) -> Result<Tag, Failure> {
        let text = std::str::from_utf8(content);
        let text = text.map_err(|_| Failure::Meaning("has a header whose text is not UTF-8".into()))?;
        let (kind, text) = match (text.strip_prefix('/'), text.strip_suffix('/')) {
            (Some(text), _) => (Kind::End, text),
            (_, Some(text)) => (Kind::Empty, text),
            _ => (Kind::Start, text),
        };
        let name = text.split_ascii_whitespace().next().unwrap_or_default().to_owned();
        let broken = |what: String| Failure::Meaning(format!("is not well-formed XML: <{}>: {what}", shown(text)));
        let start = BytesStart::from_content(text, name.len());
        let mut attributes = Vec::new();
        for attribute in start.attributes() {
            let attribute = attribute.map_err(|error| broken(error.to_string()))?;
            let value = String::from_utf8_lossy(&attribute.value);
            let value = quick_xml::escape::unescape(&value).map_err(|error| broken(error.to_string()))?;
            attributes.push((String::from_utf8_lossy(attribute.key.as_ref()).into_owned(), value.into_owned()));
        }
        Ok(Tag { kind, name, attributes, end: self.at })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Result<Vec<Tag>, Failure> {
        let mut tags = Tags::new(text.as_bytes());
        std::iter::from_fn(|| tags.next().transpose()).collect()
    }

    #[test]
    fn tags_are_found_between_texts_comments_and_quotes() {
        let text = "<?xml version='1.0'?>\n<!-- <no> -- > --><A a=\"1 2\" b='x>&lt;&quot;'>7 8<B/></A>\n";
        let tags = all(text).unwrap();
        let found: Vec<_> = tags.iter().map(|tag| (tag.kind, &*tag.name)).collect();
        assert_eq!(found, [(Kind::Start, "A"), (Kind::Empty, "B"), (Kind::End, "A")]);
        assert_eq!(tags[0].attribute("b"), Some("x><\""));
        assert_eq!(tags[0].numbers::<i64, 2>("a").unwrap(), Some([1, 2]));
        assert!(tags[0].numbers::<i64, 3>("a").is_err() && tags[0].numbers::<i64, 3>("c").unwrap().is_none());
        assert_eq!(&text[tags[0].end as usize..][..3], "7 8");
    }

    #[test]
    fn what_does_not_end_or_is_too_long_is_an_error() {
        for bad in ["<A", "<A b='>", "<!-- >", "<A b>", "<!DOCTYPE a>", "<A b='&no;'>"] {
            assert!(all(bad).is_err(), "{bad}");
        }
        assert!(all(&format!("<A b='{}'/>", " ".repeat(LONGEST_TAG))).is_err());
        assert!(all(&format!("<A b='{}'/>", " ".repeat(LONGEST_TAG / 2)).repeat(600)).is_err());
    }
}
