//! Warnings about a truth after scoring: one number would correct it, or it was annotated in part.
//!
//! A truth that is a few ticks late makes good poses look bad. So if the mean error is large, the truth is reinterpreted:
//! later or earlier, at another rate, shifted, scaled, turned, mirrored, with left and right or two body parts exchanged. A
//! reading that leaves less than half of the error is reported. A warning changes no score: the program cannot know which
//! of the two files is wrong.

mod comparison;
mod misfit;
mod similarity;
mod words;

use serde::Serialize;

use self::comparison::{NameMap, Reading, TickMap};
use self::misfit::{misfit, shift_in_part};
use self::words::in_words;
use super::Scores;
use super::lines::{PoseLines, TruthExtent};

/// Mean error up to which the truth is not reinterpreted, millimetres: such an error misleads no reader, and good runs save
/// the time.
const GOOD_MM: f64 = 30.0;
/// Share of the poses' ticks or people below which the truth is called incomplete. It covers every second tick, or two of three
/// people, but not a person who was away for a while, or a short false pose.
const MAX_INCOMPLETE_SHARE: f64 = 0.7;
/// Fewest ticks for such a warning.
const MIN_SHARED_TICKS: usize = 10;
/// The two possible causes of an incomplete truth.
const EITHER: &str = "either the truth was annotated in part (then use `--truth partial`), or the poses contain people who were \
                      not there";
/// The cause of a warning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TruthWarningCause {
    /// The truth is some ticks later or earlier than the poses, possibly in one half only, or counts ticks at another rate.
    OtherTicks,
    /// Left and right are exchanged.
    SidesExchanged,
    /// The names of two body parts are exchanged.
    PartsExchanged,
    /// The truth is a mirror image.
    Mirrored,
    /// The truth is shifted, turned or scaled, in another unit or with other axes.
    OtherCoordinates,
    /// The truth was declared whole, but seems to leave out ticks or people.
    AnnotatedInPart,
}

/// A warning about a truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TruthWarning {
    /// Its cause.
    pub cause: TruthWarningCause,
    /// What was found, as a sentence.
    #[serde(rename = "found")]
    pub message: String,
}

/// Warnings about `truth`; `scores` are those of the poses.
pub fn truth_warnings(poses: &PoseLines, truth: &PoseLines, scores: &Scores) -> Vec<TruthWarning> {
    let error_mm = scores.mean.mpjpe_mm;
    let is_good = error_mm.is_some_and(|mm| mm <= GOOD_MM);
    let misread = (!is_good).then(|| misread(poses, truth, error_mm));
    let is_whole = scores.truth == TruthExtent::Whole;
    let left_out = is_whole.then(|| partial(poses, truth)).flatten();
    let left_out = left_out.map(|message| TruthWarning {
        cause: TruthWarningCause::AnnotatedInPart,
        message,
    });
    misread.flatten().into_iter().chain(left_out).collect()
}

/// The reading of `truth` that brings it near the poses, if it is unambiguous. `error_mm` is the mean error, millimetres; `None`
/// if no pose was near.
pub fn misread(
    poses: &PoseLines,
    truth: &PoseLines,
    error_mm: Option<f64>,
) -> Option<TruthWarning> {
    let Some(misfit) = misfit(poses, truth) else {
        return shift_in_part(poses, truth).map(|message| TruthWarning {
            cause: TruthWarningCause::OtherTicks,
            message,
        });
    };
    let readings: Vec<String> = misfit.readings.iter().map(in_words).collect();
    let now = error_mm.map_or_else(String::new, |mm| format!(" instead of {mm:.0}"));
    Some(TruthWarning {
        cause: cause_of(misfit.readings.first()?),
        message: format!(
            "compared with the poses, the truth seems {}; one of the two files is wrong. After correction joints are {:.0} mm off \
             on average{now}",
            readings.join(", or "),
            1000.0 * misfit.rest_m
        ),
    })
}

fn cause_of(reading: &Reading) -> TruthWarningCause {
    if reading.ticks != TickMap::After(0) {
        TruthWarningCause::OtherTicks
    } else if reading.place.turn.determinant() < 0.0 {
        TruthWarningCause::Mirrored
    } else {
        match reading.names {
            NameMap::Unchanged => TruthWarningCause::OtherCoordinates,
            NameMap::SidesExchanged => TruthWarningCause::SidesExchanged,
            NameMap::PartsExchanged(_) => TruthWarningCause::PartsExchanged,
        }
    }
}

/// Reports a truth that was declared whole but seems to have been annotated in part, as a sentence.
fn partial(poses: &PoseLines, truth: &PoseLines) -> Option<String> {
    let is_fewer = |part: usize, whole: usize| (part as f64) < MAX_INCOMPLETE_SHARE * whole as f64;
    let span = truth.ticks().next()?..=truth.ticks().last()?;
    let in_truth = truth.ticks().count();
    let in_poses = poses.ticks().filter(|tick| span.contains(tick)).count();
    if in_poses >= MIN_SHARED_TICKS && is_fewer(in_truth, in_poses) {
        return Some(format!(
            "between its first and last tick the truth has people at {in_truth} ticks, the poses at {in_poses}; at the other \
             ticks they count as false poses: {EITHER}"
        ));
    }
    let (mut shared, mut true_people, mut posed_people) = (0, 0, 0);
    for tick in truth.ticks() {
        if let Some((truths, poses)) = truth.people_at(tick).zip(poses.people_at(tick)) {
            shared += 1;
            true_people += truths.len();
            posed_people += poses.len();
        }
    }
    (shared >= MIN_SHARED_TICKS && is_fewer(true_people, posed_people)).then(|| {
        let mean = |people: usize| people as f64 / shared as f64;
        format!(
            "the truth has {:.1} people on average where the poses have {:.1}; the others count as false poses: {EITHER}",
            mean(true_people),
            mean(posed_people)
        )
    })
}

#[cfg(test)]
mod tests;
