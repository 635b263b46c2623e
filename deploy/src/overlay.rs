//! Skeletons drawn over the images that they were estimated from, for `--overlay`.
//!
//! Joints go through the projection and the lens distortion of the camera, so that the drawing fits the raw image.
//! Where a source has no images, its keypoint candidates are drawn on a dark canvas. The id of every person is above
//! the head. Joints that no image determined are grey.

mod number;
mod place;
mod poses;

use anyhow::Context as _;
use farfield_edge::source::{FrameContent, KeypointCandidate, Sources};
use farfield_fusion::body::skeleton::Joint;
use farfield_proto::camera::{CameraModel, NEAR_PLANE_M};
use farfield_proto::frames::{Point, World};
use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use image::{Rgb, RgbImage};
use nalgebra::{Point3, Vector2};

use self::number::draw_number;
pub(crate) use self::place::draw_place;
pub(crate) use self::poses::draw_poses;
pub(crate) use self::poses::{TickList, overlay_ticks};

/// Background of keypoint candidates.
const CANVAS: Rgb<u8> = Rgb([24, 26, 30]);
/// Joints that no image determined, and the bones to them.
const GUESS: [u8; 3] = [128, 128, 128];
/// Candidates; brighter with higher score.
const CANDIDATE: [u8; 3] = [150, 155, 165];
/// Outline of bones, visible on any background.
const OUTLINE: [u8; 3] = [0, 0, 0];
/// Distance of the id above the head, in half widths of a bone: clear of the face.
const HEAD_STROKES: f64 = 12.0;
/// Pieces of a bone: a lens bends straight lines.
const PIECES: u32 = 8;
/// Bones begin slightly in front of the near plane, where projections are still finite.
const CLIP_DEPTH_M: f64 = NEAR_PLANE_M * 1.01;

/// A person to draw.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DrawnPerson {
    pub(crate) id: PersonId,
    /// World metres, in the order of the skeletal model.
    pub(crate) joints_m: Vec<[f64; 3]>,
    /// Per joint: whether no image determined it.
    pub(crate) is_guess: Vec<bool>,
}

/// The image of `camera` at `tick` with `persons` drawn over it, each in an own colour.
///
/// # Errors
/// The source cannot be opened at `tick`, or its frame cannot be read.
pub(crate) fn overlay(
    sources: &dyn Sources,
    venue: &Venue,
    camera: &VenueCamera,
    tick: Tick,
    persons: &[DrawnPerson],
) -> anyhow::Result<RgbImage> {
    let frame = sources
        .open(camera, venue, tick)?
        .next_frame()?
        .with_context(|| format!("camera `{}` has no tick {tick}", camera.model.name()))?;
    let image = background(Some(frame.content), &camera.model);
    Ok(with_people(image, &camera.model, persons))
}

/// Draws `persons` over an image of the camera.
pub(crate) fn with_people(
    mut image: RgbImage,
    camera: &CameraModel,
    persons: &[DrawnPerson],
) -> RgbImage {
    let bones = bones();
    for person in persons {
        let colour = person_colour(person.id);
        draw_skeleton(&mut image, camera, person, &bones, colour);
        draw_id(&mut image, camera, &person.joints_m, person.id);
    }
    image
}

/// The camera's image; without one, a dark image with the keypoint candidates, if any.
pub(crate) fn background(content: Option<FrameContent>, camera: &CameraModel) -> RgbImage {
    let [width, height] = camera.size_px();
    let mut canvas = RgbImage::from_pixel(width, height, CANVAS);
    match content {
        Some(FrameContent::Image(picture)) => return picture.into_rgb(),
        Some(FrameContent::Keypoints(keypoints)) => {
            draw_candidates(&mut canvas, keypoints.peaks.iter().flatten());
        }
        Some(FrameContent::Painted(painter)) => {
            let found = painter.persons();
            draw_candidates(&mut canvas, found.iter().flatten().flatten());
        }
        None => {}
    }
    canvas
}

/// Draws the id of a person above the head, if that is inside the image.
fn draw_id(image: &mut RgbImage, camera: &CameraModel, joints_m: &[[f64; 3]], person: PersonId) {
    let radius_px = stroke_radius_px(image);
    let head = joints_m.get(Joint::Head.index());
    if let Some(at) = head.and_then(|&m| pixel(camera, Point::new(Point3::from(m)))) {
        let foot = at - Vector2::new(0.0, HEAD_STROKES * radius_px);
        draw_number(image, person.0, foot, radius_px, person_colour(person));
    }
}

/// Every joint with its parent, as indices in the order of the skeletal model.
fn bones() -> Vec<(usize, usize)> {
    let bone = |joint: Joint| Some((joint.parent()?.index(), joint.index()));
    Joint::ALL.into_iter().filter_map(bone).collect()
}

/// Draws one body. `bones` are pairs of joint indices; pairs out of range are skipped. Parts behind the camera, or
/// beyond the range of the lens model, are not drawn.
fn draw_skeleton(
    image: &mut RgbImage,
    camera: &CameraModel,
    person: &DrawnPerson,
    bones: &[(usize, usize)],
    colour: [u8; 3],
) {
    let radius_px = stroke_radius_px(image);
    let joints_m = &person.joints_m;
    let joint = |i: usize| joints_m.get(i).map(|&m| Point::new(Point3::from(m)));
    let colour_of = |i: usize| match person.is_guess.get(i) {
        Some(true) => GUESS,
        _ => colour,
    };
    let lines: Vec<_> = bones
        .iter()
        .filter_map(|&(a, b)| Some((bone_pixels(camera, joint(a)?, joint(b)?), colour_of(b))))
        .collect();
    for is_outline in [true, false] {
        for (line, colour) in &lines {
            let (radius_px, colour) = if is_outline {
                (radius_px + 1.0, OUTLINE)
            } else {
                (radius_px, *colour)
            };
            for piece in line.windows(2) {
                if let [Some(from), Some(to)] = *piece {
                    draw_line(image, from, to, radius_px, colour);
                }
            }
        }
    }
    for (i, p_w) in (0..joints_m.len()).filter_map(|i| Some((i, joint(i)?))) {
        let Some(at) = pixel(camera, p_w) else {
            continue;
        };
        let light = colour_of(i).map(|c| c / 2 + 127);
        draw_line(image, at, at, radius_px * 1.6, OUTLINE);
        draw_line(image, at, at, radius_px * 1.2, light);
    }
}

/// A colour that differs clearly from those of persons with neighbouring ids.
fn person_colour(person: PersonId) -> [u8; 3] {
    /// Steps of the golden section never come back near an earlier hue.
    const TURN: f64 = 0.618_033_988_749_895;
    let hue = (f64::from(person.0) * TURN).fract() * 6.0;
    [0.0, 4.0, 2.0].map(|shift: f64| {
        let distance = ((hue + shift).rem_euclid(6.0) - 3.0).abs();
        (55.0 + 200.0 * (distance - 1.0).clamp(0.0, 1.0)) as u8
    })
}

/// Draws keypoint candidates as small crosses, brighter with higher score.
fn draw_candidates<'a>(image: &mut RgbImage, found: impl Iterator<Item = &'a KeypointCandidate>) {
    let arm_px = stroke_radius_px(image) * 2.0;
    for candidate in found {
        let at = candidate.position.vector_px();
        let share = 0.35 + 0.65 * f64::from(candidate.score).clamp(0.0, 1.0);
        let colour = CANDIDATE.map(|c| (f64::from(c) * share) as u8);
        for arm in [Vector2::new(arm_px, arm_px), Vector2::new(arm_px, -arm_px)] {
            draw_line(image, at - arm, at + arm, 0.6, colour);
        }
    }
}

/// Half the width of a bone: 2 pixels in an image of height 800.
fn stroke_radius_px(image: &RgbImage) -> f64 {
    (f64::from(image.width().min(image.height())) / 400.0).max(1.0)
}

fn pixel(camera: &CameraModel, p_w: Point<World>) -> Option<Vector2<f64>> {
    let px = camera.distort(camera.project(p_w)?)?.vector_px();
    px.iter().all(|c| c.is_finite()).then_some(px)
}

/// The corners of a bone's pieces in the raw image; `None` beyond the range of the lens model. Empty for a bone behind
/// the camera.
fn bone_pixels(
    camera: &CameraModel,
    a_w: Point<World>,
    b_w: Point<World>,
) -> Vec<Option<Vector2<f64>>> {
    let depth_m = |p_w: Point<World>| (*camera.camera_from_world() * p_w).coordinates_m().z;
    let (depth_a, depth_b) = (depth_m(a_w), depth_m(b_w));
    let in_front = depth_a.max(depth_b) > CLIP_DEPTH_M;
    if !in_front {
        return Vec::new();
    }
    // Where the bone crosses the clip plane, as a share of its length.
    let crossing = (CLIP_DEPTH_M - depth_a) / (depth_b - depth_a);
    let start = if depth_a < CLIP_DEPTH_M {
        crossing
    } else {
        0.0
    };
    let end = if depth_b < CLIP_DEPTH_M {
        crossing
    } else {
        1.0
    };
    let (a, b) = (a_w.coordinates_m(), b_w.coordinates_m());
    (0..=PIECES)
        .map(|i| start + (end - start) * f64::from(i) / f64::from(PIECES))
        .map(|share| pixel(camera, Point::new(a + (b - a) * share)))
        .collect()
}

/// Draws a line with round ends, blended over one pixel at its edge; a disc if `from` equals `to`.
fn draw_line(
    image: &mut RgbImage,
    from: Vector2<f64>,
    to: Vector2<f64>,
    radius_px: f64,
    colour: [u8; 3],
) {
    let reach = radius_px + 1.0;
    let span = |from: f64, to: f64, size: u32| {
        // Casts saturate, so a line outside the image gives an empty range.
        let first = (from.min(to) - reach).ceil().max(0.0) as u32;
        let end = (from.max(to) + reach + 1.0).max(0.0) as u32;
        first..end.min(size)
    };
    let columns = span(from.x, to.x, image.width());
    let rows = span(from.y, to.y, image.height());
    let along = to - from;
    let scale = along.norm_squared().max(f64::MIN_POSITIVE).recip();
    for y in rows {
        for x in columns.clone() {
            let offset = Vector2::new(f64::from(x), f64::from(y)) - from;
            let share = (offset.dot(&along) * scale).clamp(0.0, 1.0);
            let distance_px = (offset - along * share).norm();
            let cover = (radius_px + 0.5 - distance_px).clamp(0.0, 1.0);
            if cover > 0.0 {
                blend(image.get_pixel_mut(x, y), colour, cover);
            }
        }
    }
}

fn blend(pixel: &mut Rgb<u8>, colour: [u8; 3], cover: f64) {
    for (channel, new) in pixel.0.iter_mut().zip(colour) {
        let mixed = f64::from(*channel) * (1.0 - cover) + f64::from(new) * cover;
        *channel = mixed.round() as u8;
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use farfield_proto::frames::Transform;
    use nalgebra::Isometry3;

    use super::*;

    const RED: [u8; 3] = [255, 0, 0];

    /// Faces +z from the origin.
    fn camera(distortion: Distortion) -> CameraModel {
        let intrinsics = Intrinsics {
            fx_px: 100.0,
            fy_px: 100.0,
            cx_px: 79.5,
            cy_px: 59.5,
        };
        let pose = Transform::new(Isometry3::identity());
        CameraModel::new("front", [160, 120], intrinsics, distortion, pose).unwrap()
    }

    fn person(joints_m: &[[f64; 3]]) -> DrawnPerson {
        DrawnPerson {
            id: PersonId(1),
            joints_m: joints_m.to_vec(),
            is_guess: vec![false; joints_m.len()],
        }
    }

    fn drawn(camera: &CameraModel, joints_m: &[[f64; 3]]) -> RgbImage {
        let mut image = RgbImage::new(160, 120);
        draw_skeleton(&mut image, camera, &person(joints_m), &[(0, 1)], RED);
        image
    }

    fn is_red(image: &RgbImage, x: u32, y: u32) -> bool {
        let [r, g, b] = image.get_pixel(x, y).0;
        r > 200 && g < 40 && b < 40
    }

    #[test]
    fn a_bone_is_drawn_where_it_projects() {
        let image = drawn(
            &camera(Distortion::default()),
            &[[-1.0, 0.0, 2.0], [1.0, 0.0, 2.0]],
        );
        assert!(is_red(&image, 60, 59) && is_red(&image, 100, 60));
        assert!(!is_red(&image, 60, 64) && !is_red(&image, 20, 59));
    }

    #[test]
    fn a_bone_to_an_undetermined_joint_is_grey() {
        let camera = camera(Distortion::default());
        let mut image = RgbImage::new(160, 120);
        let joints_m = [[-1.0, 0.0, 2.0], [0.0, 0.0, 2.0], [1.0, 0.0, 2.0]];
        let person = DrawnPerson {
            is_guess: vec![false, false, true],
            ..person(&joints_m)
        };
        draw_skeleton(&mut image, &camera, &person, &[(0, 1), (1, 2)], RED);
        assert!(is_red(&image, 50, 59));
        assert_eq!(image.get_pixel(105, 59).0, GUESS);
    }

    #[test]
    fn a_bone_bends_with_the_lens() {
        let barrel = Distortion {
            k1: -0.1,
            ..Distortion::default()
        };
        let camera = camera(barrel);
        let joints_m = [[-1.4, 0.8, 2.0], [1.4, 0.8, 2.0]];
        let image = drawn(&camera, &joints_m);
        for x_m in [-1.0, 0.0, 1.0] {
            let at = pixel(&camera, Point::new(Point3::new(x_m, 0.8, 2.0))).unwrap();
            assert!(
                is_red(&image, at.x.round() as u32, at.y.round() as u32),
                "{x_m}"
            );
        }
    }

    #[test]
    fn a_bone_that_passes_the_camera_is_drawn_up_to_it() {
        let image = drawn(
            &camera(Distortion::default()),
            &[[0.0, 0.5, 2.0], [0.0, 0.5, -2.0]],
        );
        // Only the part in front: from 25 pixels below the centre down.
        assert!(is_red(&image, 79, 100) && is_red(&image, 79, 119));
        assert!(!is_red(&image, 79, 70));
    }

    #[test]
    fn invalid_or_invisible_joints_draw_nothing() {
        let camera = camera(Distortion::default());
        let nothing = RgbImage::new(160, 120);
        for wrong in [
            [0.0, 0.0, -1.0],
            [1e9, 1e9, 1.0],
            [f64::NAN; 3],
            [0.0, f64::INFINITY, 1.0],
        ] {
            assert!(drawn(&camera, &[wrong, wrong]) == nothing, "{wrong:?}");
        }
        let mut image = nothing.clone();
        draw_skeleton(&mut image, &camera, &person(&[]), &[(0, 1), (7, 99)], RED);
        assert!(image == nothing);
    }

    #[test]
    fn every_joint_except_the_root_has_a_bone() {
        assert_eq!(bones().len(), Joint::ALL.len() - 1);
    }

    #[test]
    fn the_first_people_have_colours_far_apart() {
        let colours: Vec<_> = (1..=6).map(|id| person_colour(PersonId(id))).collect();
        for (i, a) in colours.iter().enumerate() {
            for b in &colours[..i] {
                let apart: i32 = (0..3)
                    .map(|c| (i32::from(a[c]) - i32::from(b[c])).abs())
                    .sum();
                assert!(apart > 60, "{a:?} {b:?}");
            }
        }
    }
}
