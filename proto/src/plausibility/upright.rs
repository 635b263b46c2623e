//! The vertical axis: most cameras are mounted with upright pictures, so most of them show it.

use crate::venue::Field;

use super::{Cause, Finding, Severity, Sight};

/// Sine of the largest roll of an upright camera: 30 degrees.
const ROLLED: f64 = 0.5;
/// Minimum cosine between an upright camera's picture direction up and the vertical.
const UPWARD: f64 = 0.3;
/// A camera that looks within about 20 degrees of the vertical has no upward direction.
const OVERHEAD: f64 = 0.94;
/// Share of the cameras that must agree on another vertical before the world counts as turned.
const AGREED: f64 = 0.75;
/// Cosine of the angle between the views of two cameras from different sides.
const SIDES: f64 = 0.5;

/// Height above which cameras look down at people, metres above the floor; and the sine of the
/// upward angle, 3 degrees, above which a camera looks up.
const OVER_HEADS_M: f64 = 1.5;
const LOOKS_UP: f64 = 0.05;

/// Whether a camera at this height above the floor (metres), with this z of its viewing direction
/// (unit vector), is above people's heads and looks up. A correct camera that films people does
/// not.
pub fn looks_over_heads(above_floor_m: f64, forward_z: f64) -> bool {
    above_floor_m > OVER_HEADS_M && forward_z > LOOKS_UP
}

/// The possible up directions of a world, by name.
const AXES: [(&str, [f64; 3]); 5] = [
    ("-z", [0.0, 0.0, -1.0]),
    ("+y", [0.0, 1.0, 0.0]),
    ("-y", [0.0, -1.0, 0.0]),
    ("+x", [1.0, 0.0, 0.0]),
    ("-x", [-1.0, 0.0, 0.0]),
];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Whether the picture is upright if `axis` is up.
fn is_upright(sight: &Sight, axis: [f64; 3]) -> bool {
    dot(sight.right, axis).abs() < ROLLED && dot(sight.up, axis) > UPWARD
}

fn has_upward(sight: &Sight) -> bool {
    sight.forward[2].abs() < OVERHEAD
}

pub(super) fn findings(sights: &[Sight], field: &Field) -> Vec<Finding> {
    let upright = |axis: [f64; 3]| sights.iter().filter(|it| is_upright(it, axis)).count();
    let judged = sights.iter().filter(|it| has_upward(it)).count();
    // A camera that looks straight down counts as upright.
    if sights.len() >= 2 && 2 * (upright(Z) + sights.len() - judged) < sights.len() {
        let (name, axis, count) = AXES
            .into_iter()
            .map(|(name, axis)| (name, axis, upright(axis)))
            .max_by_key(|(_, _, count)| *count)
            .unwrap_or(("-z", AXES[0].1, 0));
        if count >= 2 && count as f64 >= AGREED * sights.len() as f64 {
            if let Some(finding) = turned_world(sights, field, name, axis, count) {
                return vec![finding];
            }
        } else {
            return vec![no_agreement(sights)];
        }
    }
    let rolled = sights.iter().filter_map(rolled);
    rolled.chain(looking_up(sights, field)).collect()
}

/// All cameras are above people's heads and look up. For places in a plane the mirror image fits
/// equally well, and from it upright cameras look at the other side of the horizon.
fn looking_up(sights: &[Sight], field: &Field) -> Option<Finding> {
    let looks_up =
        |sight: &Sight| looks_over_heads(sight.center_m[2] - field.floor_m, sight.forward[2]);
    (sights.len() >= 2 && sights.iter().all(looks_up)).then(|| Finding {
        camera: None,
        cause: Cause::LookUp,
        severity: Severity::Doubtful,
        found: "all cameras look up, from above where people stand".to_owned(),
        expected: "cameras that look down at people".to_owned(),
        remedy: "the calibration is a mirror image of the venue: was y counted from below in what it was made from, were the \
                 pictures mirrored or the known places? If they really look up (at divers, at trapezes), all is well"
            .to_owned(),
    })
}

/// The world has `axis` up; `None` if the cameras are rather mounted upside down.
fn turned_world(
    sights: &[Sight],
    field: &Field,
    name: &str,
    axis: [f64; 3],
    count: usize,
) -> Option<Finding> {
    let floor_m = field.floor_m.min(0.0);
    let below = sights.iter().filter(|it| it.center_m[2] < floor_m).count();
    let is_down = axis[2] < 0.0;
    if is_down && 2 * below < sights.len() {
        return None;
    }
    // Cameras from one side that lie on their sides look like a turned world.
    let sides = sights
        .iter()
        .any(|a| sights.iter().any(|b| dot(a.forward, b.forward) < SIDES));
    let severity = if is_down || sides {
        Severity::Wrong
    } else {
        Severity::Doubtful
    };
    let turn = match name {
        "-z" => "turn it by half a turn about x: (x, y, z) becomes (x, -y, -z)",
        "+y" => "turn it: (x, y, z) becomes (x, -z, y)",
        "-y" => "turn it: (x, y, z) becomes (x, z, -y)",
        "+x" => "turn it: (x, y, z) becomes (y, z, x)",
        _ => "turn it: (x, y, z) becomes (-y, z, -x)",
    };
    Some(Finding {
        camera: None,
        cause: Cause::WorldAxes,
        severity,
        found: format!(
            "{count} of {} cameras are upright only if {name} of the world is up",
            sights.len()
        ),
        expected: "z up, with the floor at 0".to_owned(),
        remedy: format!(
            "the world of the calibration has another axis up; {turn}, in the tool that wrote it"
        ),
    })
}

fn no_agreement(sights: &[Sight]) -> Finding {
    let upright = sights.iter().filter(|it| is_upright(it, Z)).count();
    Finding {
        camera: None,
        cause: Cause::WorldAxes,
        severity: Severity::Doubtful,
        found: format!(
            "the cameras do not agree on which way is up: {upright} of {} are upright where z is",
            sights.len()
        ),
        expected: "most pictures upright".to_owned(),
        remedy:
            "check `rotation`: world to camera, radians, in the order of the calibration's cameras"
                .to_owned(),
    }
}

/// A single camera whose picture is not upright.
fn rolled(sight: &Sight) -> Option<Finding> {
    if !has_upward(sight) || is_upright(sight, Z) {
        return None;
    }
    // The vertical in the picture: its angle to the picture's upper edge.
    let roll_deg = libm::atan2(dot(sight.right, Z), dot(sight.up, Z)).to_degrees();
    // Pictures with up to the right were turned clockwise, and are turned back counterclockwise.
    let (cause, found, turn_deg, filter) = match roll_deg.abs() {
        135.0.. => (
            Cause::UpsideDown,
            "its picture is upside down".to_owned(),
            180,
            "hflip,vflip",
        ),
        45.0.. => {
            let (way, turn_deg, filter) = if roll_deg > 0.0 {
                ("clockwise", -90, "transpose=2")
            } else {
                ("counterclockwise", 90, "transpose=1")
            };
            let found = format!(
                "its picture is turned {way} by {:.0} degrees",
                roll_deg.abs()
            );
            (Cause::Sideways, found, turn_deg, filter)
        }
        _ => return None,
    };
    let name = &sight.name;
    let remedy = if sight.has_pictures {
        format!(
            "networks read people who stand: turn the pictures (`ffmpeg -i IN -vf {filter} OUT`) and the calibration with them \
             (`farfield calibrate convert FILE --turn {name}={turn_deg} --out DIR`), which then is of the turned pictures"
        )
    } else {
        "if the camera hangs like this, nothing has to be turned: its keypoints come from a file; else its `rotation` is wrong"
            .to_owned()
    };
    Some(Finding {
        camera: Some(sight.name.clone()),
        cause,
        severity: Severity::Doubtful,
        found,
        expected: "one in which people stand".to_owned(),
        remedy,
    })
}
