//! Gzip decoder for files of several members, like `gzip` itself. Ignores trailing zeros, with which tapes and file systems fill blocks.

use flate2::bufread::GzDecoder;
use std::io::{BufRead, Read, Result};

/// Inflated bytes of all members.
pub(crate) struct GzipMembers<R>(Option<GzDecoder<R>>);

impl<R: BufRead> GzipMembers<R> {
    pub(crate) fn new(file: R) -> Self {
        Self(Some(GzDecoder::new(file)))
    }
}

impl<R: BufRead> Read for GzipMembers<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        while let Some(member) = &mut self.0 {
            let count = member.read(buffer)?;
            if count > 0 || buffer.is_empty() {
                return Ok(count);
            }
            self.0 = match self.0.take().map(GzDecoder::into_inner) {
                Some(mut file) => is_more(&mut file)?.then(|| GzDecoder::new(file)),
                None => None,
            };
        }
        Ok(0)
    }
}

/// Skips zeros. Returns whether anything follows them.
fn is_more(file: &mut impl BufRead) -> Result<bool> {
    loop {
        let bytes = file.fill_buf()?;
        let zeros = bytes.iter().take_while(|byte| **byte == 0).count();
        if zeros < bytes.len() || bytes.is_empty() {
            return Ok(!bytes.is_empty());
        }
        file.consume(zeros);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn member(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn inflated(file: &[u8]) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        // A small buffer ends within zeros.
        let file = std::io::BufReader::with_capacity(7, file);
        GzipMembers::new(file).read_to_end(&mut bytes).map(|_| bytes)
    }

    #[test]
    fn members_are_one_file_and_zeros_behind_them_are_none() {
        let (one, two) = (member(b"one and "), member(b"two"));
        for zeros in [0, 1, 512] {
            assert_eq!(inflated(&[one.clone(), two.clone(), vec![0; zeros]].concat()).unwrap(), b"one and two");
        }
        assert_eq!(inflated(&[one.clone(), member(b""), two.clone()].concat()).unwrap(), b"one and two");
    }

    #[test]
    fn what_is_neither_member_nor_zeros_is_an_error() {
        let one = member(b"one");
        assert!(inflated(&[one.clone(), b"junk".to_vec()].concat()).is_err());
        assert!(inflated(&[one.clone(), vec![0; 9], b"j".to_vec()].concat()).is_err());
        assert!(inflated(&one[..one.len() - 3]).is_err());
    }
}
