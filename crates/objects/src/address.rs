//! Addresses: a scheme, a host or bucket, and a path there.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// An address in parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// `https`, `http`, `s3`, `gs` or `az`.
    pub scheme: String,
    /// Host and port, or bucket.
    pub authority: String,
    /// From the host or bucket on, without slashes at its ends.
    pub path: String,
}

/// Known schemes.
const SCHEMES: [&str; 5] = ["https", "http", "s3", "gs", "az"];

impl Address {
    /// Takes an address apart.
    ///
    /// # Errors
    /// If its scheme is not known, or it has no host or bucket, or a query or fragment.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (scheme, rest) = text.split_once("://").ok_or("expected SCHEME://HOST/PATH")?;
        let scheme = scheme.to_ascii_lowercase();
        if !SCHEMES.contains(&scheme.as_str()) {
            return Err(format!(
                "addresses of {scheme}:// are not read; those of {} are",
                SCHEMES.join("://, ") + "://"
            ));
        }
        let (authority, path) = rest.split_once('/').unwrap_or((rest, ""));
        if authority.is_empty() {
            return Err(format!("expected a host or bucket behind {scheme}://"));
        }
        if authority.contains('@') {
            return Err("names and passwords in addresses are not read; use a server or bucket without".into());
        }
        if let Some(mark) = path.chars().find(|c| "?#".contains(*c)) {
            return Err(format!("an address with '{mark}' names one object, not the folder of a store; leave it out"));
        }
        let parts: Vec<&str> = path.split('/').filter(|part| !part.is_empty()).collect();
        if parts.iter().any(|part| [".", ".."].contains(part)) {
            return Err("an address may not have '.' or '..' among its folders".into());
        }
        Ok(Self { scheme, authority: authority.to_owned(), path: parts.join("/") })
    }

    /// The part before the path.
    pub fn root(&self) -> String {
        format!("{}://{}", self.scheme, self.authority)
    }
}

/// Whether a path is an address: letters and `://`.
pub fn is_address(path: &Path) -> bool {
    scheme_of(path).is_some_and(|scheme| scheme != "file")
}

/// The path of a file's address, `file:///PATH`; other paths as they are.
pub fn local_path(path: &Path) -> Cow<'_, Path> {
    match path.to_str().and_then(|text| text.strip_prefix("file://")) {
        Some(rest) if rest.starts_with('/') => PathBuf::from(decoded(rest)).into(),
        Some(rest) => match rest.strip_prefix("localhost/") {
            Some(rest) => PathBuf::from(format!("/{}", decoded(rest))).into(),
            None => path.into(),
        },
        None => path.into(),
    }
}

fn scheme_of(path: &Path) -> Option<&str> {
    let (scheme, _) = path.to_str()?.split_once("://")?;
    let is_scheme = scheme.len() > 1 && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric());
    is_scheme.then_some(scheme)
}

/// A text with the bytes of each `%XX`.
fn decoded(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let digits = after.get(..2).and_then(|digits| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
        match digits.filter(|_| byte == b'%') {
            Some(decoded) => {
                bytes.push(decoded);
                rest = &after[2..];
            }
            None => {
                bytes.push(byte);
                rest = after;
            }
        }
    }
    String::from_utf8(bytes).unwrap_or_else(|_| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_scheme_a_host_and_a_path() {
        let parsed = |text: &str| Address::parse(text).map(|a| [a.scheme, a.authority, a.path].join(" "));
        assert_eq!(parsed("https://a.org:8080/b/c.zarr/").unwrap(), "https a.org:8080 b/c.zarr");
        assert_eq!(parsed("S3://bucket").unwrap(), "s3 bucket ");
        assert_eq!(parsed("gs://bucket//a").unwrap(), "gs bucket a");
        for (text, words) in [
            ("ftp://a/b", "ftp:// are not read"),
            ("s3:///a", "a host or bucket"),
            ("https://user:word@a/b", "names and passwords"),
            ("https://a/b?c=d", "'?'"),
            ("https://a/b/../c", "'..'"),
        ] {
            assert!(Address::parse(text).unwrap_err().contains(words), "{text}");
        }
    }

    #[test]
    fn paths_of_files_are_no_addresses() {
        for (text, expected) in
            [("https://a/b", true), ("a/b", false), ("/a://b", false), ("C://a", false), ("file:///a", false)]
        {
            assert_eq!(is_address(Path::new(text)), expected, "{text}");
        }
        let local = |text: &'static str| local_path(Path::new(text)).into_owned();
        assert_eq!(local("file:///a/b%20c%zz"), Path::new("/a/b c%zz"));
        assert_eq!(local("file://localhost/a"), Path::new("/a"));
        assert_eq!(local("a/b"), Path::new("a/b"));
    }
}
