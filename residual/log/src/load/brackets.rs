//! Stamps in brackets before each line, as terminals write them:
//! `[2026-03-04 10:00:00.120] 1.5,2.0`.

use std::io::{BufRead, Read};

/// Whether a log begins with such a stamp.
pub(super) fn is_stamped(head: &[u8]) -> bool {
    parts(head.split(|b| *b == b'\n').next().unwrap_or(head)).is_some()
}

/// The stamp of a line, and what follows it.
fn parts(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let rest = line.strip_prefix(b"[")?;
    let (stamp, rest) = rest.split_at(rest.iter().position(|b| *b == b']')?);
    let of_stamp = |b: &u8| b.is_ascii_digit() || b" :.,-/TZ".contains(b);
    let digits = stamp.iter().filter(|b| b.is_ascii_digit()).count();
    let rest = rest[1..].trim_ascii();
    // Without a rest it is a list in brackets.
    let is_stamp = digits > 1 && stamp.iter().all(of_stamp) && !rest.is_empty();
    is_stamp.then(|| (stamp.trim_ascii(), rest))
}

/// Makes the stamp a cell of its own, with the separator of what follows.
pub(super) struct Brackets<R> {
    inner: R,
    line: Vec<u8>,
    /// Bytes of the line that were given out.
    given: usize,
}

impl<R> Brackets<R> {
    pub(super) fn new(inner: R) -> Self {
        Self {
            inner,
            line: Vec::new(),
            given: 0,
        }
    }
}

impl<R: BufRead> Read for Brackets<R> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        if self.given == self.line.len() {
            (self.given, self.line) = (0, Vec::new());
            self.inner.read_until(b'\n', &mut self.line)?;
            if let Some((stamp, rest)) = parts(&self.line) {
                let separator = b";\t|,".iter().find(|s| rest.contains(s)).unwrap_or(&b' ');
                self.line = [stamp, &[*separator], rest, b"\n"].concat();
            }
        }
        let n = buf.len().min(self.line.len() - self.given);
        buf[..n].copy_from_slice(&self.line[self.given..self.given + n]);
        self.given += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_is_a_cell() {
        let text = "[10:00:00.1] a;b\r\n[10:00:00.2]\t1.5;2,5\n\n[info] ready\n3;4\n[12.5] 1 2";
        let mut out = String::new();
        Brackets::new(text.as_bytes())
            .read_to_string(&mut out)
            .unwrap();
        assert_eq!(
            out,
            "10:00:00.1;a;b\n10:00:00.2;1.5;2,5\n\n[info] ready\n3;4\n12.5 1 2\n"
        );
        assert!(is_stamped(text.as_bytes()));
        for other in ["[info] 1,2\n", "[[1, 2]]", "[1.5, 2.5]\n", "1,2\n", "[", ""] {
            assert!(!is_stamped(other.as_bytes()), "{other}");
        }
    }
}
