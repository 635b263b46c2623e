//! The colour of every point of a person: skin, face, hair and clothes.

use nalgebra::Vector3;

use super::grain;
use crate::body::{BodyPart, Build, Color, Cone, Hair, ShirtPattern, Volume};

/// A point of a surface.
pub(super) struct Spot<'a> {
    pub(super) cone: &'a Cone,
    /// World, metres.
    pub(super) point_m: Vector3<f64>,
    /// Unit, world.
    pub(super) normal: Vector3<f64>,
    /// From 0 at the cone's first end to 1 at the other.
    pub(super) along: f64,
}

/// Reflectance of a point of a person.
pub(super) fn color_at(spot: &Spot<'_>, volume: &Volume, build: &Build) -> Color {
    let cone = spot.cone;
    let along = cone.along[0] + (cone.along[1] - cone.along[0]) * spot.along;
    match cone.part {
        BodyPart::Head => head(spot, volume, build),
        BodyPart::Hair => tinted(build.hair_color, 0.75 + 0.5 * strands(spot, volume, build)),
        BodyPart::Neck | BodyPart::LeftHand | BodyPart::RightHand => build.skin_color,
        BodyPart::Pelvis | BodyPart::Abdomen if is_below_belt(spot, volume, build) => {
            creased(spot, build, build.trousers_color)
        }
        BodyPart::Pelvis | BodyPart::Abdomen | BodyPart::Chest | BodyPart::Girdle => {
            shirt(spot, volume, build)
        }
        BodyPart::LeftUpperArm
        | BodyPart::RightUpperArm
        | BodyPart::LeftForearm
        | BodyPart::RightForearm => {
            if along > build.sleeves {
                build.skin_color
            } else if build.pattern == ShirtPattern::Sleeves {
                creased(spot, build, build.shirt_colors[1])
            } else {
                shirt(spot, volume, build)
            }
        }
        BodyPart::LeftThigh | BodyPart::RightThigh | BodyPart::LeftShank | BodyPart::RightShank => {
            if along < build.trousers {
                creased(spot, build, build.trousers_color)
            } else if along > build.socks {
                build.socks_color
            } else {
                build.skin_color
            }
        }
        BodyPart::LeftFoot | BodyPart::RightFoot => build.shoes_color,
        BodyPart::Thing => [0.5; 3],
    }
}

fn tinted(color: Color, by: f32) -> Color {
    color.map(|v| v * by)
}

/// Cloth with folds around the limb.
fn creased(spot: &Spot<'_>, build: &Build, color: Color) -> Color {
    let p = spot.cone.to_local * (spot.point_m - spot.cone.origin_m);
    let q = [
        p.x as f32 * 14.0,
        p.y as f32 * 14.0,
        p.z as f32 * 26.0 + spot.cone.along[0] as f32 * 31.0,
    ];
    let fold = grain::smooth(build.seed ^ spot.cone.part as u64, q) - 0.5;
    tinted(color, 1.0 + 0.7 * build.creases * fold)
}

/// Whether the spot is below the hem of the shirt, which covers the top of the trousers.
fn is_below_belt(spot: &Spot<'_>, volume: &Volume, build: &Build) -> bool {
    let (middle, axes) = &volume.pelvis_m;
    axes.column(2).dot(&(spot.point_m - middle)) < build.belt * build.stature_m
}

/// Coordinates in the chest's axes: forward, left, up from the base of the neck, statures.
fn on_chest(spot: &Spot<'_>, volume: &Volume, build: &Build) -> Vector3<f64> {
    let (root, axes) = &volume.chest_m;
    axes.tr_mul(&(spot.point_m - root)) / build.stature_m
}

fn shirt(spot: &Spot<'_>, volume: &Volume, build: &Build) -> Color {
    let p = on_chest(spot, volume, build);
    let [main, second] = build.shirt_colors;
    // The collar leaves the neck free.
    if p.z > 0.0
        && p.y.abs() < 0.042
        && (p.x - 0.008).hypot(p.y) < 0.046 + 0.25 * (p.z - 0.01).abs()
        && p.z > 0.012
    {
        return build.skin_color;
    }
    let is_arm = !matches!(
        spot.cone.part,
        BodyPart::Pelvis | BodyPart::Chest | BodyPart::Abdomen | BodyPart::Girdle
    );
    let printed = match build.pattern {
        ShirtPattern::Plain | ShirtPattern::Sleeves => false,
        ShirtPattern::Hoops if is_arm => (spot.along * 4.0).rem_euclid(2.0) < 1.0,
        ShirtPattern::Hoops => (p.z / 0.035).rem_euclid(2.0) < 1.0,
        ShirtPattern::Stripes if is_arm => spot.normal.x.abs() > 0.8,
        ShirtPattern::Stripes => (p.y / 0.022 + 0.5).rem_euclid(2.0) < 1.0,
        ShirtPattern::Halves => p.y > 0.0,
        ShirtPattern::Band => !is_arm && (-0.14..-0.09).contains(&p.z),
    };
    let color = if printed { second } else { main };
    let color = match build.number {
        Some(n) if !is_arm && is_number(n, p.x < 0.0, p.y, p.z) => contrast(color, second),
        _ => color,
    };
    creased(spot, build, color)
}

/// `wanted` if it is readable on `ground`, else black or white.
fn contrast(ground: Color, wanted: Color) -> Color {
    let brightness = |c: Color| c.iter().sum::<f32>() / 3.0;
    if (brightness(ground) - brightness(wanted)).abs() > 0.25 {
        wanted
    } else if brightness(ground) > 0.3 {
        [0.02; 3]
    } else {
        [0.85; 3]
    }
}

/// Digits of 3 x 5 cells, rows from the top, three bits each.
const DIGITS: [u16; 10] = [
    0b111_101_101_101_111,
    0b010_110_010_010_111,
    0b111_001_111_100_111,
    0b111_001_111_001_111,
    0b101_101_111_001_001,
    0b111_100_111_001_111,
    0b111_100_111_101_111,
    0b111_001_010_010_010,
    0b111_101_111_101_111,
    0b111_101_111_001_111,
];

/// Whether a number is printed at a position of the chest: large on the back, small in front.
fn is_number(number: u8, is_back: bool, left: f64, up: f64) -> bool {
    let (cell, top) = if is_back {
        (0.024, -0.05)
    } else {
        (0.013, -0.06)
    };
    // The viewer's right is the person's left in front, and the person's right on the back.
    let x = if is_back { -left } else { left };
    let row = (top - up) / cell;
    if !(0.0..5.0).contains(&row) {
        return false;
    }
    let digits: &[u8] = if number >= 10 {
        &[number / 10, number % 10]
    } else {
        &[number]
    };
    let width = digits.len() as f64 * 4.0 - 1.0;
    // Columns run to the viewer's right.
    let column = x / cell + width / 2.0;
    if !(0.0..width).contains(&column) {
        return false;
    }
    let (digit, bit) = ((column / 4.0) as usize, (column % 4.0) as usize);
    bit < 3 && DIGITS[digits[digit] as usize] >> (14 - (row as usize * 3 + bit)) & 1 == 1
}

fn strands(spot: &Spot<'_>, volume: &Volume, build: &Build) -> f32 {
    let (middle, axes) = &volume.head_m;
    let p = axes.tr_mul(&(spot.point_m - middle)) / build.stature_m;
    grain::smooth(
        build.seed,
        [p.x as f32 * 120.0, p.y as f32 * 260.0, p.z as f32 * 60.0],
    )
}

/// Hair, eyes, brows, lips and cheeks.
fn head(spot: &Spot<'_>, volume: &Volume, build: &Build) -> Color {
    let (middle, axes) = &volume.head_m;
    let local = |p: &Vector3<f64>| axes.tr_mul(&(p - middle)) / build.stature_m;
    let p = local(&spot.point_m);
    let temple = 0.010 + 0.012 * (p.y.abs() / 0.04).min(1.0);
    if build.hair != Hair::Bald && 0.9 * p.z - 0.75 * p.x > temple && (p.z > -0.02 || p.x < -0.02) {
        let by = 0.75 + 0.5 * strands(spot, volume, build);
        return tinted(build.hair_color, by);
    }
    if p.x < 0.015 {
        return build.skin_color;
    }
    for eye in volume.eyes_m {
        let e = local(&eye);
        let (l, u) = (p.y - e.y, p.z - e.z);
        if (l / 0.0035).hypot(u / 0.0035) < 1.0 {
            return [0.02, 0.015, 0.012];
        }
        if (l / 0.0085).hypot(u / 0.0042) < 1.0 {
            return [0.72, 0.7, 0.68];
        }
        if (l / 0.0115).hypot(u / 0.0068) < 1.0 {
            return tinted(build.skin_color, 0.62);
        }
        if (u - 0.012 + 8.0 * l * l).abs() < 0.0028 && l.abs() < 0.0125 {
            return tinted(build.hair_color, 0.8);
        }
    }
    let lips = (p.y / 0.0145).hypot((p.z + 0.0245) / 0.0042);
    if lips < 1.0 {
        let [r, g, b] = build.skin_color;
        return [r * 0.72, g * 0.42, b * 0.42];
    }
    let [r, g, b] = build.skin_color;
    let flush = (1.0 - ((p.y.abs() - 0.024) / 0.016).hypot((p.z + 0.008) / 0.016)).max(0.0) as f32;
    [r, g * (1.0 - 0.18 * flush), b * (1.0 - 0.18 * flush)]
}
