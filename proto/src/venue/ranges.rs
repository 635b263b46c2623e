//! The ranges in which the parameters make sense.

use super::parameters::Parameters;
use crate::toml_file::{FileError, Place, TomlFile};

/// Refuses the first parameter that is out of its range, with its table and field.
pub(super) fn check(file: &TomlFile<'_>, parameters: &Parameters) -> Result<(), FileError> {
    for (table, field, value, min, max) in ranges(parameters) {
        // NaN is in no range.
        if !(min..=max).contains(&value) {
            let problem = format!("found {value:?}, expected a number from {min} to {max}");
            return Err(file.error(&Place::field(table).key(field), problem));
        }
    }
    let boxes = &parameters.boxes;
    if boxes.rotate_until_deg > boxes.rotate_from_deg {
        let problem = format!(
            "found {:?}, expected at most `rotate_from_deg` ({:?})",
            boxes.rotate_until_deg, boxes.rotate_from_deg
        );
        return Err(file.error(&Place::field("boxes").key("rotate_until_deg"), problem));
    }
    Ok(())
}

/// Table, field, value, least and largest.
type Bounded = (&'static str, &'static str, f64, f64, f64);

macro_rules! bounds {
    ($all:ident.$table:ident.$field:ident: $min:expr, $max:expr) => {
        (
            stringify!($table),
            stringify!($field),
            f64::from($all.$table.$field),
            $min,
            $max,
        )
    };
}

fn ranges(p: &Parameters) -> Vec<Bounded> {
    let mut all = vec![
        bounds!(p.lattice.half_width_m: 0.01, 2.0),
        bounds!(p.lattice.coarse_step_cells: 0.1, 16.0),
        bounds!(p.lattice.fine_per_coarse: 1.0, 32.0),
        bounds!(p.lattice.prior_sigma_m: 0.005, 10.0),
        bounds!(p.lattice.min_support: 0.0, 1.0),
        bounds!(p.lattice.independent_angle_deg: 0.0, 90.0),
        bounds!(p.occlusion.weight: 0.0, 1.0),
        bounds!(p.occlusion.limb_radius_m: 0.0, 1.0),
        bounds!(p.occlusion.trunk_radius_m: 0.0, 1.0),
        bounds!(p.occlusion.head_radius_m: 0.0, 1.0),
        bounds!(p.contact.yield_share: 0.0, 1.0),
        bounds!(p.contact.seen_sigma_m: 1e-3, 10.0),
        bounds!(p.contact.unseen_sigma_m: 1e-3, 10.0),
        bounds!(p.contact.exchange_margin: 1e-3, 2.0),
        bounds!(p.contact.separation_weight: 0.0, 100.0),
        bounds!(p.contact.body_share: 0.0, 2.0),
        bounds!(p.ik.iterations: 1.0, 1000.0),
        bounds!(p.ik.tolerance_rad: 1e-12, 0.1),
        bounds!(p.ik.keypoint_sigma_m: 1e-4, 1.0),
        bounds!(p.ik.min_weight: 0.0, 1.0),
        bounds!(p.ik.rest_sigma_rad: 1e-3, 100.0),
        bounds!(p.ik.change_sigma_rad: 1e-4, 100.0),
        bounds!(p.ik.prediction_weight: 0.0, 1.0),
        bounds!(p.ik.joint_sigma_m: 1e-4, 1.0),
        bounds!(p.smoothing.cutoff_hz: 0.01, 1000.0),
        bounds!(p.smoothing.cutoff_rise_hz_per_m: 0.0, 1e5),
        bounds!(p.smoothing.cutoff_rise_per_m: 0.0, 1e3),
        bounds!(p.smoothing.innovation_cutoff_hz: 0.01, 1000.0),
        bounds!(p.smoothing.coast_decay_s: 1e-3, 1e3),
        bounds!(p.smoothing.delay_ms: 0.0, 2000.0),
        bounds!(p.prediction.velocity_decay_s: 1e-3, 1e3),
        bounds!(p.prediction.body_velocity_decay_s: 1e-3, 1e3),
        bounds!(p.range_of_motion.factor: 0.5, 2.0),
        bounds!(p.boxes.rotate_from_deg: 0.0, 180.0),
        bounds!(p.boxes.rotate_until_deg: 0.0, 180.0),
        bounds!(p.boxes.end_on_ratio: 0.0, 1.0),
        bounds!(p.boxes.acceleration_m_s2: 0.0, 100.0),
        bounds!(p.births.sight_every_s: 0.0, 3600.0),
        bounds!(p.births.tiles_per_look: 0.0, 256.0),
        bounds!(p.births.ray_distance_m: 1e-3, 10.0),
        bounds!(p.births.min_score: 0.0, 1.0),
        bounds!(p.births.min_keypoints: 1.0, 64.0),
        bounds!(p.births.confirm_ticks: 1.0, 1e5),
        bounds!(p.births.tentative_s: 0.0, 3600.0),
        bounds!(p.births.coast_s: 0.0, 3600.0),
        bounds!(p.births.one_view_s: 0.0, 3600.0),
        bounds!(p.births.return_s: 0.0, 86400.0),
        bounds!(p.births.return_speed_m_s: 0.0, 100.0),
        bounds!(p.births.flat_m: 0.0, 1.0),
        bounds!(p.births.moved_m: 0.0, 10.0),
        bounds!(p.births.still_s: 0.0, 60.0),
        bounds!(p.births.explained_m: 0.0, 10.0),
        bounds!(p.births.look_again_ticks: 0.0, 1e5),
        bounds!(p.births.look_share: 0.0, 1.0),
        bounds!(p.births.min_seen_keypoints: 1.0, 64.0),
        bounds!(p.births.same_place_m: 0.0, 10.0),
        bounds!(p.births.measure_s: 0.0, 3600.0),
        bounds!(p.births.same_place_s: 0.0, 3600.0),
        bounds!(p.births.outside_field_m: 0.0, 1e3),
        bounds!(p.link.lockstep_timeout_s: 0.1, 86400.0),
        bounds!(p.link.budget_bytes_per_s: 0.0, 1e9),
        bounds!(p.link.deadline_ms: 1.0, 5000.0),
        bounds!(p.link.clock_bound_ms: 1.0, 10_000.0),
        bounds!(p.recording.chunk_s: 0.05, 60.0),
        bounds!(p.recording.retention_days: 0.0, 36500.0),
        bounds!(p.recording.ring_mib: 0.0, 65536.0),
        bounds!(p.recording.fill_share: 0.0, 1.0),
    ];
    let margin = p.boxes.margin;
    all.extend(margin.map(|margin| ("boxes", "margin", margin, 1.0, 4.0)));
    all
}
