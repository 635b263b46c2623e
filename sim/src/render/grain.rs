//! Repeatable randomness by position: hashes and smooth noise.

pub(super) fn hash(v: u64) -> u64 {
    let mut z = v.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A number from 0 to 1 for a cell of a grid.
pub(super) fn cell(seed: u64, [x, y, z]: [i32; 3]) -> f32 {
    let mut h = (seed as u32) ^ ((seed >> 32) as u32).wrapping_mul(0x9e37_79b1);
    for v in [x, y, z] {
        h = (h ^ v as u32).wrapping_mul(0x85eb_ca6b);
        h ^= h >> 15;
    }
    h = h.wrapping_mul(0xc2b2_ae35);
    (h >> 8) as f32 / 16_777_216.0
}

/// Smooth noise from 0 to 1 with a period of about one unit.
pub(super) fn smooth(seed: u64, p: [f32; 3]) -> f32 {
    let base = p.map(|v| v.floor() as i32);
    let f: [f32; 3] = std::array::from_fn(|i| {
        let t = p[i] - base[i] as f32;
        t * t * (3.0 - 2.0 * t)
    });
    let at = |dx: i32, dy: i32, dz: i32| cell(seed, [base[0] + dx, base[1] + dy, base[2] + dz]);
    let along = |dy, dz| at(0, dy, dz) + (at(1, dy, dz) - at(0, dy, dz)) * f[0];
    let plane = |dz| along(0, dz) + (along(1, dz) - along(0, dz)) * f[1];
    plane(0) + (plane(1) - plane(0)) * f[2]
}

/// [`smooth`] over a plane.
pub(super) fn smooth2(seed: u64, [x, y]: [f32; 2]) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let ease = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (ease(x - i), ease(y - j));
    let at = |dx: i32, dy: i32| cell(seed, [i as i32 + dx, j as i32 + dy, 0]);
    let upper = at(0, 0) + (at(1, 0) - at(0, 0)) * fx;
    let lower = at(0, 1) + (at(1, 1) - at(0, 1)) * fx;
    upper + (lower - upper) * fy
}
