//! Logical lines of OBJ and MTL files, each with the number of its first physical line.

use std::borrow::Cow;

/// A logical line: physical lines joined at `\`, trimmed.
pub(super) struct Line {
    /// Number of the first physical line, from 1.
    pub number: usize,
    /// What it says, without the line end.
    pub text: String,
}

impl Line {
    /// First word and the trimmed rest; `None` for an empty line or a comment.
    pub fn key(&self) -> Option<(&str, &str)> {
        let text = self.text.as_str();
        if text.is_empty() || text.starts_with('#') {
            return None;
        }
        let (key, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        Some((key, rest.trim()))
    }
}

/// Words up to a comment.
pub(super) fn words(rest: &str) -> impl Iterator<Item = &str> {
    rest.split_whitespace().take_while(|word| !word.starts_with('#'))
}

/// A line as text: UTF-8 where it is valid, else one character a byte.
///
/// The second form is not what the author wrote, but two names that differ stay different, which a replacement
/// character would not guarantee.
fn decode(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|b| char::from(*b)).collect()),
    }
}

/// Splits a file into logical lines.
///
/// Lines end with a line feed; carriage returns before it are dropped, however many. A file without any line feed is
/// taken to end its lines with carriage returns. A byte order mark at the start is dropped.
pub(super) fn logical_lines(bytes: &[u8]) -> Vec<Line> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
    let mut lines: Vec<Line> = Vec::new();
    let mut continues = false;
    for (k, raw) in bytes.split(|b| *b == end).enumerate() {
        let decoded = decode(raw);
        let text = decoded.trim_matches(|c: char| c.is_whitespace() || c.is_control());
        // A backslash continues a list of numbers; in a comment or a path of another system it means nothing.
        let (text, joins) = match text.strip_suffix('\\') {
            Some(start) if !text.starts_with('#') => (start, true),
            _ => (text, false),
        };
        match lines.last_mut() {
            Some(last) if continues => {
                last.text.push(' ');
                last.text.push_str(text);
            }
            _ => lines.push(Line { number: k + 1, text: text.to_owned() }),
        }
        continues = joins;
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(bytes: &[u8]) -> Vec<(usize, String)> {
        let filled = logical_lines(bytes).into_iter().filter(|line| !line.text.is_empty());
        filled.map(|line| (line.number, line.text)).collect()
    }

    #[test]
    fn carriage_returns_and_byte_order_marks_vanish_and_numbers_stay() {
        let expected = vec![(1, "v 1".to_owned()), (3, "usemtl wood".to_owned())];
        assert_eq!(texts(b"\xef\xbb\xbfv 1\r\n\r\nusemtl wood\r\r\n"), expected);
        assert_eq!(texts(b"v 1\r\rusemtl wood\r"), expected);
    }

    #[test]
    fn a_continued_line_has_the_number_of_its_start() {
        assert_eq!(texts(b"f 1 2 \\\r\n3\\\n4\nl 1"), [(1, "f 1 2  3 4".to_owned()), (4, "l 1".to_owned())]);
    }

    #[test]
    fn a_backslash_at_the_end_of_a_comment_joins_nothing() {
        assert_eq!(texts(b"# C:\\models\\\nv 1").len(), 2);
    }

    #[test]
    fn bytes_that_are_no_utf_8_stay_apart() {
        let lines = texts(b"usemtl \xd0\nusemtl \xd1\nusemtl \xd0\xb4");
        assert_eq!(
            (lines[0].1.as_str(), lines[1].1.as_str(), lines[2].1.as_str()),
            ("usemtl Ð", "usemtl Ñ", "usemtl д")
        );
    }
}
