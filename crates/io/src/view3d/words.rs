//! A View3D file as words with their lines.

use std::path::Path;

use super::View3dFault;
use crate::ReadError;
use crate::error::shown;

/// Dashes that word processors put in place of a minus sign.
const DASHES: [char; 5] = ['\u{2010}', '\u{2011}', '\u{2012}', '\u{2013}', '\u{2212}'];

/// A line: its number from 1, and its words before any comment.
pub(super) struct Line {
    pub number: usize,
    pub words: Vec<String>,
    /// All behind the first word, for titles.
    pub rest: String,
}

/// The lines that say something. `!` begins a comment anywhere, `/` at the start of a line; line ends of any system.
pub(super) fn lines(bytes: &[u8]) -> Vec<Line> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    let mut lines = Vec::new();
    for (k, raw) in bytes.split(|b| *b == end).enumerate() {
        let text = String::from_utf8_lossy(raw).replace(DASHES, "-");
        let said = text.split('!').next().unwrap_or_default().trim();
        if said.is_empty() || said.starts_with('/') {
            continue;
        }
        let words: Vec<String> = said.split_whitespace().map(str::to_owned).collect();
        let rest = said.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim()).to_owned();
        lines.push(Line { number: k + 1, words, rest });
    }
    lines
}

/// Words of a statement, which may run on over the following lines.
pub(super) struct Words<'a> {
    path: &'a Path,
    lines: &'a [Line],
    line: usize,
    word: usize,
}

impl<'a> Words<'a> {
    pub fn new(path: &'a Path, lines: &'a [Line]) -> Self {
        Self { path, lines, line: 0, word: 0 }
    }

    /// The next line as a whole, which begins a statement: its words are read from the second on.
    pub fn next_line(&mut self) -> Option<&'a Line> {
        // Words that are left on a line that has been begun belong to nothing: remarks without a `!`.
        if self.word > 0 {
            self.line += 1;
        }
        self.word = 1;
        self.lines.get(self.line)
    }

    /// Number of the line being read.
    pub fn number(&self) -> usize {
        self.lines.get(self.line).or(self.lines.last()).map_or(0, |line| line.number)
    }

    /// An error at the line being read.
    pub fn fault(&self, fault: View3dFault) -> ReadError {
        ReadError::View3d { path: self.path.to_owned(), line: self.number(), fault }
    }

    /// The next word on this line.
    pub fn on_line(&mut self) -> Option<&'a str> {
        let word = self.lines.get(self.line)?.words.get(self.word)?;
        self.word += 1;
        Some(word)
    }

    /// The next word on this line or a later one.
    fn anywhere(&mut self) -> Option<&'a str> {
        while self.line < self.lines.len() {
            if let Some(word) = self.on_line() {
                return Some(word);
            }
            (self.line, self.word) = (self.line + 1, 0);
        }
        None
    }

    /// A whole number on this line.
    pub fn whole(&mut self, what: &'static str) -> Result<u64, ReadError> {
        let word = self.on_line().ok_or_else(|| self.fault(View3dFault::Missing { what }))?;
        word.parse().map_err(|_| self.fault(View3dFault::Number { what, word: shown(word) }))
    }

    /// A finite number on this line.
    pub fn number_on_line(&mut self, what: &'static str) -> Result<f64, ReadError> {
        let word = self.on_line();
        self.finite(word, what)
    }

    /// A finite number on this line or a later one.
    pub fn number_anywhere(&mut self, what: &'static str) -> Result<f64, ReadError> {
        let word = self.anywhere();
        self.finite(word, what)
    }

    fn finite(&self, word: Option<&str>, what: &'static str) -> Result<f64, ReadError> {
        let word = word.ok_or_else(|| self.fault(View3dFault::Missing { what }))?;
        let number = word.parse().ok().filter(|x: &f64| x.abs() <= crate::obj::LARGEST);
        number.ok_or_else(|| self.fault(View3dFault::Number { what, word: shown(word) }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_carriage_returns_and_typeset_dashes_are_understood() {
        let read = lines("V 1 1.e\u{2011}4 ! x\r\n\r\n/ remark\r\n! all\r\ns 1\r\n".as_bytes());
        let words: Vec<(usize, String)> = read.iter().map(|line| (line.number, line.words.join(" "))).collect();
        assert_eq!(words, [(1, "V 1 1.e-4".to_owned()), (5, "s 1".to_owned())]);
    }
}
