//! Names of people: from operators on the page, in edits, in profiles and in venue files.

use crate::plain_text::is_plain;

/// Longest name, characters.
pub const MOST_NAME_CHARACTERS: usize = 64;
/// Checks a new name. An empty name is valid: it removes a name.
///
/// # Errors
/// The found and expected text.
pub fn check_name(name: &str) -> Result<(), String> {
    check_stored_name(name)?;
    if !name.chars().all(is_plain) {
        return Err(format!(
            "found {name:?}, expected a name without invisible characters and direction marks"
        ));
    }
    Ok(())
}

/// Checks a name in a file: older programs of ours allowed more.
///
/// # Errors
/// The found and expected text.
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
