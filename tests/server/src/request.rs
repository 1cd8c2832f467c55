//! Requests of HTTP/1.1: the line, and the headers that the server heeds.

use crate::Answer;
use std::io::{self, Read};
use std::net::TcpStream;

/// Most bytes of a request's head.
const MOST_BYTES: usize = 64 << 10;

/// Bytes asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Range {
    /// From the first to the last, both included; to the end without a last one.
    From(u64, Option<u64>),
    /// So many at the end.
    Last(u64),
}

impl Range {
    /// First byte, and the one behind the last, in a file of so many.
    pub(crate) fn within(self, bytes: u64) -> (u64, u64) {
        match self {
            Self::From(first, last) => (first, last.map_or(bytes, |last| last.saturating_add(1).min(bytes))),
            Self::Last(count) => (bytes.saturating_sub(count), bytes),
        }
    }

    fn parse(text: &str) -> Option<Self> {
        let (first, last) = text.trim().strip_prefix("bytes=")?.split_once('-')?;
        match (first, last) {
            ("", last) => Some(Self::Last(last.parse().ok()?)),
            (first, "") => Some(Self::From(first.parse().ok()?, None)),
            (first, last) => Some(Self::From(first.parse().ok()?, Some(last.parse().ok()?))),
        }
    }
}

/// A request for a file.
pub(crate) struct Request {
    /// Decoded, without the first slash.
    pub(crate) path: String,
    pub(crate) is_head: bool,
    pub(crate) range: Option<Range>,
    pub(crate) if_match: Option<String>,
    pub(crate) if_none_match: Option<String>,
}

impl Request {
    /// Reads a request; `None` if the connection ended.
    pub(crate) fn read(connection: &mut TcpStream) -> io::Result<Option<Self>> {
        let (mut head, mut byte) = (Vec::new(), [0]);
        while !head.ends_with(b"\r\n\r\n") {
            if head.len() == MOST_BYTES || connection.read(&mut byte)? == 0 {
                return Ok(None);
            }
            head.push(byte[0]);
        }
        let text = String::from_utf8_lossy(&head);
        let mut lines = text.split("\r\n");
        let mut first = lines.next().unwrap_or_default().split(' ');
        let (method, target) = (first.next().unwrap_or_default(), first.next().unwrap_or_default());
        let mut request = Self {
            path: decoded(target.split('?').next().unwrap_or_default().trim_start_matches('/')),
            is_head: method == "HEAD",
            range: None,
            if_match: None,
            if_none_match: None,
        };
        for (name, value) in lines.filter_map(|line| line.split_once(':')) {
            let value = value.trim();
            match name.to_ascii_lowercase().as_str() {
                "range" => request.range = Range::parse(value),
                "if-match" => request.if_match = Some(value.into()),
                "if-none-match" => request.if_none_match = Some(value.into()),
                _ => {}
            }
        }
        Ok(Some(request))
    }

    /// First byte and length of an answer to a request for a range.
    pub(crate) fn range_in(&self, answer: &Answer) -> Option<(u64, u64)> {
        let (_, rest) = answer.headers.split_once("content-range: bytes ")?;
        let first = rest.split('-').next()?.parse().ok()?;
        self.range.map(|_| (first, answer.body.len() as u64))
    }
}

fn decoded(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let digits = after.get(..2).and_then(|digits| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
        match digits.filter(|_| byte == b'%') {
            Some(code) => {
                bytes.push(code);
                rest = &after[2..];
            }
            None => {
                bytes.push(byte);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
