//! What `farfield evaluate` has found, as a table and as JSON.

use farfield_score::Scores;
use farfield_score::table::side_by_side;
use farfield_score::truth_warnings::TruthWarning;

/// What is printed as JSON: the scores, and what stands beside them.
#[derive(Debug, serde::Serialize)]
pub(super) struct Evaluation {
    #[serde(flatten)]
    pub(super) scored: Scored,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) beside: Option<Scored>,
}

/// The scores of some poses.
#[derive(Debug, serde::Serialize)]
pub(super) struct Scored {
    #[serde(flatten)]
    pub(super) scores: Scores,
    /// What speaks against the truth that they are held against.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) doubts: Vec<TruthWarning>,
}

impl Evaluation {
    pub(super) fn table(&self) -> String {
        let scores = &self.scored.scores;
        let Some(Scored { scores: beside, .. }) = &self.beside else {
            return scores.to_string();
        };
        let named = [("POSES", scores), ("--beside", beside)];
        format!(
            "POSES: {}\n--beside: {}\n\n{}\nPOSES: {}\n--beside: {}\nPOSES: {}\n--beside: {}",
            scores.sentence(),
            beside.sentence(),
            side_by_side(15, &named),
            scores.identity_line(),
            beside.identity_line(),
            scores.lives,
            beside.lives
        )
    }
}
