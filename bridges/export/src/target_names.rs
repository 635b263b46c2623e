//! Restrictions on names in the programs that read our files, one function per rule. People may
//! have almost any name.
//!
//! | target | restriction | function |
//! | --- | --- | --- |
//! | file names | letters, digits, `-`, `_`; limited in bytes | [`file_word`] |
//! | OSIM, TRC, MOT | no blank, tab, line end, `\ / * +`; unique markers | `opensim_name`, `point_names` of `farfield_fusion` |
//! | C3D | at most 127 bytes, since lengths are signed bytes; unique labels | [`c3d_text`], [`c3d_labels`] |
//! | CSV | any text, quoted by its writer | |
//! | Parquet, glTF, MCAP | any UTF-8 text | |
//! | BVH | one word per bone; contains no names of people | `BoneNames` |

use std::collections::BTreeSet;

/// Maximum characters and bytes of a name in a file name. File systems allow 255 bytes, of which
/// our own words, a number and the temporary suffix need up to 60.
const MOST_WORD_CHARACTERS: usize = 64;
const MOST_WORD_BYTES: usize = 192;
/// Maximum size of names and texts in a C3D file, bytes; lengths are one byte, which some readers
/// treat as signed.
pub(crate) const C3D_BYTES: usize = 127;

/// Converts `name` to a part of a file name: characters other than letters, digits, `-` and `_`
/// become `_`.
pub(crate) fn file_word(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || c == '-' {
            c
        } else {
            '_'
        }
    };
    let word: String = name.chars().take(MOST_WORD_CHARACTERS).map(safe).collect();
    shortened(&word, MOST_WORD_BYTES).to_owned()
}

/// Truncates `text` for a C3D file.
pub(crate) fn c3d_text(text: &str) -> &str {
    shortened(text, C3D_BYTES)
}

/// Truncates `labels` for a C3D file and makes them unique: duplicates end with a number.
pub(crate) fn c3d_labels(labels: Vec<String>) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let fitted = labels.into_iter().map(|label| {
        let whole = c3d_text(&label).to_owned();
        let numbered = (2..).map(|number: u64| {
            let end = format!("_{number}");
            shortened(&label, C3D_BYTES - end.len()).to_owned() + &end
        });
        let mut texts = std::iter::once(whole).chain(numbered);
        let free = texts.find(|text| !taken.contains(text)).unwrap_or_default();
        taken.insert(free.clone());
        free
    });
    fitted.collect()
}

/// The beginning of `text` with whole characters and at most `most_bytes` bytes.
fn shortened(text: &str, most_bytes: usize) -> &str {
    &text[..text.floor_char_boundary(most_bytes)]
}

#[cfg(test)]
mod tests;
