//! Poses of a run in the formats of other programs.
//!
//! [`skeleton`] is the one export skeleton, which every animated format shares, and [`axes`] are the units and axes a
//! program expects.

pub mod axes;
pub mod run;
pub mod skeleton;
pub mod timeline;

#[cfg(test)]
pub(crate) mod fixture;

/// The value of that name, of those a command line may name.
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
