//! Zenoh's error messages, for operators.

/// Zenoh's message without the places in its own source, ` at FILE.rs:LINE.`, which do not help an
/// operator.
pub fn without_places(text: &str) -> String {
    let mut parts = text.split(" at ");
    let mut kept = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| c.is_whitespace() || c == ']');
        let (word, rest) = part.split_at(end.unwrap_or(part.len()));
        if word.contains(".rs:") {
            kept.push_str(rest);
        } else {
            kept.push_str(" at ");
            kept.push_str(part);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    #[test]
    fn source_places_are_removed_from_zenohs_messages() {
        let message = "Can not create a new TCP listener at [::]:1: [tcp: Address in use (os error 98) at /r/src/a-1/unicast.rs:367.] at /r/src/b-2/tcp.rs:12. - Caused by x";
        assert_eq!(
            super::without_places(message),
            "Can not create a new TCP listener at [::]:1: [tcp: Address in use (os error 98)] - Caused by x"
        );
    }
}
