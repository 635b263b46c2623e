//! Whether a camera of a marker system films video, and what is said of one that does not.
//!
//! A list of models goes out of date with the next camera, and a camera that is missing is worse than one too many: what a list
//! does not know is taken.

use super::camera::{Remark, RemarkKind};

/// Whether a camera films.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Films {
    /// The file says so, or says nothing of its model.
    Known,
    /// Nothing known decides.
    Perhaps,
    /// It only sees markers, or its picture is empty.
    Never,
}

/// Which of the cameras are taken, each with its name and model; what is not certain is in `remarks`.
pub(super) fn taken(cameras: &[(&str, String, Films)], remarks: &mut Vec<Remark>) -> Vec<bool> {
    let some_film = cameras.iter().any(|(_, _, films)| *films != Films::Never);
    let decide = |(name, model, films): &(&str, String, Films)| {
        let text = match films {
            Films::Known => return true,
            Films::Perhaps => format!("model `{model}` is not known: taken, as it may film"),
            Films::Never if some_film => {
                format!("model `{model}` sees markers and films no video: left out")
            }
            Films::Never => {
                format!("model `{model}` sees markers and films no video, like all others: taken")
            }
        };
        remarks.push(Remark::of_camera(RemarkKind::Assumed, name, text));
        *films != Films::Never || !some_film
    };
    cameras.iter().map(decide).collect()
}

/// The words of a model in small letters.
pub(super) fn words(model: &str) -> Vec<String> {
    let words = model.split(|c: char| !c.is_alphanumeric());
    words.map(str::to_lowercase).collect()
}
