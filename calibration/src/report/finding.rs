//! What speaks against a calibration.

use farfield_proto::finding::Severity;

/// What kind of mistake it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// A camera has no pose: it shares too little with the others, or agrees with none.
    NotConnected,
    /// Much of what a camera saw does not fit.
    Outliers,
    /// The sights do not determine something.
    Degenerate,
    /// A camera's place is known badly.
    Uncertain,
    /// The halves of the data disagree: a camera was moved, or a clock wanders.
    HalvesDisagree,
    /// The halves of the data could not be compared.
    HalvesUnchecked,
    /// The focal length had to move far from the given one.
    Focal,
    /// Residuals are much larger than those of other cameras.
    Residual,
    /// The lens model folds inside the picture.
    LensFolds,
    /// Nothing says how long a metre is.
    NoScale,
    /// Nothing says which way is up.
    NoFloor,
    /// Known places are far from where they were found.
    Anchors,
    /// The world is mirrored or on its head, or nothing tells whether it is.
    Handedness,
    /// A camera fits at some times and not at others: it was moved, or its clock jumped.
    Knocked,
    /// A camera is under the floor.
    UnderFloor,
    /// People walked where they tell little of the cameras: along one line, at one distance.
    Walk,
    /// Feet do not lie on one plane, or people do not stand upright on it.
    Feet,
    /// Too few people were seen for too short a time.
    TooFewPeople,
    /// The clock of a camera is not as given.
    Clock,
    /// A part of the field is seen by too few cameras, or most of a picture saw nothing.
    Coverage,
    /// People come out larger or smaller than they are.
    Stature,
}

/// One thing that speaks against a calibration.
pub type Finding = farfield_proto::finding::Finding<Cause>;

/// A finding of a camera, or of all where `camera` is empty.
pub(crate) fn finding(
    camera: &str,
    cause: Cause,
    is_wrong: bool,
    found: String,
    expected: &str,
    remedy: &str,
) -> Finding {
    Finding {
        camera: (!camera.is_empty()).then(|| camera.to_owned()),
        cause,
        severity: if is_wrong {
            Severity::Wrong
        } else {
            Severity::Doubtful
        },
        found,
        expected: expected.to_owned(),
        remedy: remedy.to_owned(),
    }
}
