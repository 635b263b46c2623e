//! What people may be called: by operators on the page, in edits, in profiles and in venue files.

use crate::plain_text::is_plain;

/// Most characters of a name.
pub const MOST_NAME_CHARACTERS: usize = 64;
/// Why nobody can be called `name` from now on, if nobody can. An empty name is no fault here: it takes a name away.
///
/// # Errors
/// What was found and what is expected.
pub fn check_name(name: &str) -> Result<(), String> {
    check_stored_name(name)?;
    if !name.chars().all(is_plain) {
        return Err(format!(
            "found {name:?}, expected a name without characters that are not seen and turn the text around them"
        ));
    }
    Ok(())
}

/// The same of a name in a file: older programs of ours wrote more.
///
/// # Errors
/// What was found and what is expected.
pub fn check_stored_name(name: &str) -> Result<(), String> {
    let n = name.chars().count();
    if n > MOST_NAME_CHARACTERS {
        return Err(format!(
            "found {n} characters, expected at most {MOST_NAME_CHARACTERS}"
        ));
    }
    if name.chars().any(char::is_control) || name.trim() != name {
        return Err(format!(
            "found {name:?}, expected a name without control characters and blanks around it"
        ));
    }
    Ok(())
}
