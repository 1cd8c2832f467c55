//! Texts in XML. Costs their bytes.

/// A text in an attribute of XML. Control characters, which XML has none for, become blanks.
pub(crate) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\u{fffe}' | '\u{ffff}' => escaped.push(' '),
            control if control.is_control() => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn marks_are_escaped_and_control_characters_are_blanks() {
        assert_eq!(escaped("a<b> & \"c\"\n\u{1b}\u{b5}"), "a&lt;b&gt; &amp; &quot;c&quot;  \u{b5}");
    }
}
