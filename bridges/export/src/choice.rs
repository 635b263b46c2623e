//! Choices that a command line names.

/// The value of that name.
///
/// # Errors
/// The names that there are.
pub(crate) fn named<T: Copy>(name: &str, all: &[(&'static str, T)]) -> Result<T, String> {
    let found = all.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|(known, _)| *known).collect();
        format!("`{name}` is not one of {}", known.join(", "))
    })
}
