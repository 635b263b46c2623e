//! Which mistakes of a calibration are looked for.

/// What kind of mistake was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// Another axis of the world than z points up, or z points down.
    WorldAxes,
    /// The file takes camera to world.
    Backwards,
    /// The file's cameras have y up and z backward.
    CameraAxes,
    /// A camera stands below the floor.
    UnderFloor,
    /// A camera hangs higher, or stands lower, than cameras do.
    Height,
    /// A camera's picture is upside down.
    UpsideDown,
    /// A camera's picture is turned by about 90 degrees.
    Sideways,
    /// All cameras hang above people and look up: the calibration is a mirror image.
    LookUp,
    /// A rotation vector is longer than half a turn.
    LongRotation,
    /// The field of view is not one of a lens with the picture's size.
    FieldOfView,
    /// The focal lengths along rows and columns differ.
    PixelShape,
    /// The principal point is far from the picture's middle.
    PrincipalPoint,
    /// The distortion is not one of a lens.
    Distortion,
    /// All cameras are very near each other, or very far apart: another unit of length.
    Units,
    /// All cameras stand so far from the origin that poses are coarse.
    FarOrigin,
    /// Two cameras stand at the same place.
    SamePlace,
    /// Cameras of one viewpoint stand far from each other.
    ViewpointApart,
    /// A camera sees no part of the field.
    LooksAway,
    /// Little of the field is seen from two viewpoints.
    FieldUnseen,
    /// The field is too low, too narrow or too wide for people.
    FieldSize,
    /// There is one viewpoint alone.
    OneViewpoint,
    /// Pictures of another size than the calibration's.
    PictureSize,
}

impl Cause {
    /// As programs read it.
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

/// One thing that speaks against a calibration.
pub type Finding = crate::finding::Finding<Cause>;
