//! The detectable mistakes of a calibration.

/// The kind of a mistake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// An axis other than z points up, or z points down.
    WorldAxes,
    /// The file's poses are camera to world.
    Backwards,
    /// The file's cameras have y up and z backward.
    CameraAxes,
    /// A camera is below the floor.
    UnderFloor,
    /// A camera has an unusual height.
    Height,
    /// A camera's picture is upside down.
    UpsideDown,
    /// A camera's picture is turned by about 90 degrees.
    Sideways,
    /// All cameras are above people and look up: the calibration is a mirror image.
    LookUp,
    /// A rotation vector is longer than half a turn.
    LongRotation,
    /// The field of view does not match a lens and the picture's size.
    FieldOfView,
    /// The focal lengths along rows and columns differ.
    PixelShape,
    /// The principal point is far from the picture's middle.
    PrincipalPoint,
    /// The distortion is not plausible for a lens.
    Distortion,
    /// All cameras are very close together or very far apart: another unit of length.
    Units,
    /// All cameras are so far from the origin that poses are coarse.
    FarOrigin,
    /// Two cameras are at the same place.
    SamePlace,
    /// Cameras of one viewpoint are far apart.
    ViewpointApart,
    /// A camera sees no part of the field.
    LooksAway,
    /// Two viewpoints see little of the field.
    FieldUnseen,
    /// The field is too low, too narrow or too wide for people.
    FieldSize,
    /// There is only one viewpoint.
    OneViewpoint,
    /// Pictures of another size than the calibration's.
    PictureSize,
}

impl Cause {
    /// The name for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::WorldAxes => "world_axes",
            Self::Backwards => "backwards",
            Self::CameraAxes => "camera_axes",
            Self::UnderFloor => "under_floor",
            Self::Height => "height",
            Self::UpsideDown => "upside_down",
            Self::Sideways => "sideways",
            Self::LookUp => "look_up",
            Self::LongRotation => "long_rotation",
            Self::FieldOfView => "field_of_view",
            Self::PixelShape => "pixel_shape",
            Self::PrincipalPoint => "principal_point",
            Self::Distortion => "distortion",
            Self::Units => "units",
            Self::FarOrigin => "far_origin",
            Self::SamePlace => "same_place",
            Self::ViewpointApart => "viewpoint_apart",
            Self::LooksAway => "looks_away",
            Self::FieldUnseen => "field_unseen",
            Self::FieldSize => "field_size",
            Self::OneViewpoint => "one_viewpoint",
            Self::PictureSize => "picture_size",
        }
    }
}

/// One reason against a calibration.
pub type Finding = crate::finding::Finding<Cause>;
