//! What speaks against a truth once it has been scored: that one number would mend it, or that it was annotated in part.
//!
//! A score is told for whatever truth is given, and a truth that is a few ticks late looks like poses that are bad. So where the
//! mean error is large the truth is read in other ways (later or earlier, at another rate, elsewhere, of another size, turned,
//! mirrored, with left and right or two parts of the body exchanged), and if one of these leaves less than half of the error, that is said. A doubt
//! changes no score: nobody here knows which of the two files is wrong.

mod comparison;
mod in_part;
mod misfit;
mod partial;
mod similarity;
mod words;

use serde::Serialize;

use self::comparison::{Names, Reading, TickMap};
use self::in_part::in_part;
use self::misfit::misfit;
use self::partial::partial;
use self::words::in_words;
use super::Scores;
use super::lines::{PoseLines, TruthExtent};

/// Mean error up to which nothing is looked for, millimetres: nobody is misled by so little, and good runs pay nothing.
const GOOD_MM: f64 = 30.0;

/// What is doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DoubtCause {
    /// The truth is some ticks later or earlier than the poses, also in a half of the time, or counts them at another rate.
    OtherTicks,
    /// Left is right in it.
    SidesExchanged,
    /// Two parts of the body have each other's names in it.
    PartsExchanged,
    /// It is a mirror image.
    Mirrored,
    /// It is shifted, turned or scaled, in another unit or with other axes.
    OtherCoordinates,
    /// It was taken for whole, and seems to leave ticks or people out.
    AnnotatedInPart,
}

/// Something that speaks against a truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Doubt {
    /// Of which kind.
    pub cause: DoubtCause,
    /// What was found, in a sentence.
    pub found: String,
}

/// What speaks against `truth`, of which the poses have those `scores`.
pub fn doubts(poses: &PoseLines, truth: &PoseLines, scores: &Scores) -> Vec<Doubt> {
    let error_mm = scores.mean.mpjpe_mm;
    let is_good = error_mm.is_some_and(|mm| mm <= GOOD_MM);
    let misread = (!is_good).then(|| misread(poses, truth, error_mm));
    let is_whole = scores.truth == TruthExtent::Whole;
    let left_out = is_whole.then(|| partial(poses, truth)).flatten();
    let left_out = left_out.map(|found| Doubt {
        cause: DoubtCause::AnnotatedInPart,
        found,
    });
    misread.flatten().into_iter().chain(left_out).collect()
}

/// How `truth` would have to be read to be near the poses, if that is clear; without the mean error (millimetres) nothing was near.
pub fn misread(poses: &PoseLines, truth: &PoseLines, error_mm: Option<f64>) -> Option<Doubt> {
    let Some(misfit) = misfit(poses, truth) else {
        return in_part(poses, truth).map(|found| Doubt {
            cause: DoubtCause::OtherTicks,
            found,
        });
    };
    let ways: Vec<String> = misfit.readings.iter().map(in_words).collect();
    let now = error_mm.map_or_else(String::new, |mm| format!(" instead of {mm:.0}"));
    Some(Doubt {
        cause: cause_of(misfit.readings.first()?),
        found: format!(
            "against the poses the truth seems {}: one of the two is wrong; put right, joints are {:.0} mm off on average{now}",
            ways.join(", or "),
            1000.0 * misfit.rest_m
        ),
    })
}

fn cause_of(reading: &Reading) -> DoubtCause {
    if reading.ticks != TickMap::After(0) {
        DoubtCause::OtherTicks
    } else if reading.place.turn.determinant() < 0.0 {
        DoubtCause::Mirrored
    } else {
        match reading.names {
            Names::AsTheyAre => DoubtCause::OtherCoordinates,
            Names::SidesExchanged => DoubtCause::SidesExchanged,
            Names::PartsExchanged(_) => DoubtCause::PartsExchanged,
        }
    }
}

#[cfg(test)]
mod tests;
