//! Data that is constant while a server runs: the response of `/api/venue`.

use farfield_proto::court::PlacedCourt;
use farfield_proto::venue::{Field, Venue, VenueCamera};
use serde::Serialize;

use super::PROTOCOL;
use super::text::{ActionKind, Mode, json};
use crate::skeleton::Skeleton;

#[derive(Serialize)]
struct VenueDocument<'a> {
    protocol: u8,
    release: &'static str,
    venue: &'a str,
    mode: Mode,
    rate_hz: f64,
    field: FieldLines,
    court: Option<CourtLines<'a>>,
    viewpoints: Vec<ViewpointLine<'a>>,
    cameras: Vec<CameraLines<'a>>,
    #[serde(flatten)]
    skeleton: &'a Skeleton,
    actions: &'a [ActionKind],
    /// Whether cameras may have thumbnails.
    pictures: bool,
}

#[derive(Serialize)]
#[expect(
    clippy::struct_field_names,
    reason = "the names are those of the venue file"
)]
struct FieldLines {
    min_m: [f64; 3],
    max_m: [f64; 3],
    floor_m: f64,
}

impl From<Field> for FieldLines {
    fn from(field: Field) -> Self {
        Self {
            min_m: field.min_m,
            max_m: field.max_m,
            floor_m: field.floor_m,
        }
    }
}

#[derive(Serialize)]
struct CourtLines<'a> {
    name: &'a str,
    lines: Vec<PaintedLine<'a>>,
}

#[derive(Serialize)]
struct PaintedLine<'a> {
    name: &'a str,
    /// World x and y, rounded to millimetres.
    points_m: Vec<[f64; 2]>,
}

impl<'a> From<&'a PlacedCourt> for CourtLines<'a> {
    fn from(placed: &'a PlacedCourt) -> Self {
        let to_mm = |m: f64| (m * 1000.0).round() / 1000.0;
        let lines = placed.court.lines.iter().map(|line| {
            let points_m = placed.points_m(&line.shape).into_iter();
            PaintedLine {
                name: &line.name,
                points_m: points_m.map(|at| at.map(to_mm)).collect(),
            }
        });
        Self {
            name: placed.court.name,
            lines: lines.collect(),
        }
    }
}

#[derive(Serialize)]
struct ViewpointLine<'a> {
    name: &'a str,
    cameras: Vec<u16>,
}

#[derive(Serialize)]
struct CameraLines<'a> {
    name: &'a str,
    viewpoint: u16,
    size_px: [u32; 2],
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    /// World to camera, by rows.
    rotation: [[f64; 3]; 3],
    translation_m: [f64; 3],
    position_m: [f64; 3],
}

impl<'a> From<&'a VenueCamera> for CameraLines<'a> {
    fn from(camera: &'a VenueCamera) -> Self {
        let model = &camera.model;
        let intrinsics = model.intrinsics();
        let camera_from_world = model.camera_from_world().isometry();
        let rotation = camera_from_world.rotation.to_rotation_matrix();
        let row = |i: usize| std::array::from_fn(|j| rotation[(i, j)]);
        Self {
            name: model.name(),
            viewpoint: camera.viewpoint.0,
            size_px: model.size_px(),
            fx_px: intrinsics.fx_px,
            fy_px: intrinsics.fy_px,
            cx_px: intrinsics.cx_px,
            cy_px: intrinsics.cy_px,
            rotation: [row(0), row(1), row(2)],
            translation_m: camera_from_world.translation.vector.into(),
            position_m: model.center().coordinates_m().into(),
        }
    }
}

/// The document of a venue whose people have this skeleton.
pub fn document(venue: &Venue, skeleton: &Skeleton, mode: Mode, actions: &[ActionKind]) -> String {
    let viewpoints = venue.viewpoints.iter().map(|viewpoint| ViewpointLine {
        name: &viewpoint.name,
        cameras: viewpoint.cameras.iter().map(|camera| camera.0).collect(),
    });
    json(&VenueDocument {
        protocol: PROTOCOL,
        release: env!("CARGO_PKG_VERSION"),
        venue: &venue.name,
        mode,
        rate_hz: venue.rate_hz,
        field: venue.field.into(),
        court: venue.court.as_ref().map(CourtLines::from),
        viewpoints: viewpoints.collect(),
        cameras: venue.cameras.iter().map(CameraLines::from).collect(),
        skeleton,
        actions,
        pictures: mode == Mode::Live && venue.security.pictures,
    })
}
