//! What the programs that read our files take as a name. One function for each rule; people may be called almost anything.
//!
//! | target | what it takes | by |
//! | --- | --- | --- |
//! | file names | letters, digits, `-`, `_`; as many bytes as every disk takes | [`file_word`] |
//! | OSIM, TRC, MOT | no blank, tab, line end, `\ / * +`; each marker once | `opensim_name`, `point_names` of `farfield_fusion` |
//! | C3D | at most 127 bytes, as lengths are signed bytes; each label once | [`c3d_text`], [`c3d_labels`] |
//! | CSV | any text, quoted by its writer | |
//! | Parquet, glTF, MCAP | any text of UTF-8 | |
//! | BVH | one word per bone; names of people are not in it | `BoneNames` |

use std::collections::BTreeSet;

/// Most characters of a name that go into the name of a file, and most bytes: disks take 255, of which our own words, a
/// number and the ending of an unfinished file need up to 60.
const MOST_WORD_CHARACTERS: usize = 64;
const MOST_WORD_BYTES: usize = 192;
/// Longest name and text of a C3D file, bytes: their lengths are a byte, and some readers take it for signed.
pub(crate) const C3D_BYTES: usize = 127;

/// `name` as a part of a file's name: what is no letter, digit, `-` or `_` becomes `_`.
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

/// `text` as a C3D file has room for it.
pub(crate) fn c3d_text(text: &str) -> &str {
    shortened(text, C3D_BYTES)
}

/// `labels` as a C3D file has room for them, each once: what would be there twice ends in a number.
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

/// The beginning of `text`, of whole characters and at most so many bytes.
fn shortened(text: &str, most_bytes: usize) -> &str {
    &text[..text.floor_char_boundary(most_bytes)]
}

#[cfg(test)]
mod tests;
