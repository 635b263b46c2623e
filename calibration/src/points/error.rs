//! Why no calibration could be made.

use farfield_proto::camera::CameraError;

/// Why no calibration could be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// A camera's intrinsics cannot be used.
    #[error(transparent)]
    Camera(CameraError),
    /// Fewer than two cameras.
    #[error("found {found} cameras, expected at least 2")]
    TooFewCameras {
        /// How many there are.
        found: usize,
    },
    /// A camera saw too little.
    #[error(
        "camera `{camera}`: found {found} sightings that its lens can draw, expected at least {least}"
    )]
    TooFewSightings {
        /// The camera's name.
        camera: String,
        /// How many there are.
        found: usize,
        /// How many are needed.
        least: usize,
    },
    /// Sightings lie outside of the picture.
    #[error(
        "camera `{camera}`: {outside} of {of} sightings lie outside of its {}x{} picture: they are of another camera, or \
         `size` is of another resolution",
        size_px[0], size_px[1]
    )]
    OutsidePicture {
        /// The camera's name.
        camera: String,
        /// Sightings outside.
        outside: usize,
        /// All sightings.
        of: usize,
        /// Width and height.
        size_px: [u32; 2],
    },
    /// A frame rate is missing or is none.
    #[error("camera `{camera}`: `rate_hz`: found {found:?}, expected 0.1 to 100000")]
    Rate {
        /// The camera's name.
        camera: String,
        /// What it is.
        found: f64,
    },
    /// Two cameras have one name.
    #[error("two cameras are called `{camera}`, expected different names")]
    SameName {
        /// The name.
        camera: String,
    },
    /// An offset is missing.
    #[error(
        "camera `{camera}`: `offset_s` is missing or not finite, expected seconds where clocks are given"
    )]
    Offset {
        /// The camera's name.
        camera: String,
    },
    /// No two cameras agree about anything.
    #[error(
        "no two cameras agree on how they stand to each other: found at best {share_percent:.0} % of {moments} common \
         moments that agree, in cameras `{first}` and `{second}`; expected half of 15 or more. Look at rates, offsets and \
         intrinsics, or carry the point where several cameras see it"
    )]
    NothingAgrees {
        /// One camera of the best pair.
        first: String,
        /// The other.
        second: String,
        /// Moments that both saw.
        moments: usize,
        /// Share of them that agrees.
        share_percent: f64,
    },
    /// A number of the request, or what it says of the venue, is none that can be used.
    #[error("{0}")]
    Request(String),
    /// What is known of the venue cannot be laid on the result.
    #[error("{0}")]
    Alignment(String),
}
