//! Fields in the wrong place.

use super::super::parameters::{Audience, PARAMETERS};
use super::check;

/// A table of the venue in these tests at which parameters may be.
const TUNED: &str = "[tuning]\nlattice.half_width_m = 0.3";

#[test]
fn a_field_of_tuning_is_refused_elsewhere_with_its_place() {
    check(
        TUNED,
        "[births]\nflat_m = 0.05",
        "34: `births.flat_m`: it belongs at `[tuning] births.flat_m`",
    );
    check(
        TUNED,
        "[smoothing]\ndelay_ms = 100.0\ncutoff_hz = 2.0\n[ik]\niterations = 12",
        "35: `smoothing.cutoff_hz`: it belongs at `[tuning] smoothing.cutoff_hz`",
    );
    check(
        TUNED,
        "[contact]",
        "33: `contact`: it belongs at `[tuning] contact`",
    );
}

#[test]
fn a_users_field_is_refused_under_tuning() {
    check(
        TUNED,
        "[tuning]\nbirths.flat_m = 0.05\nbirths.coast_s = 2.0",
        "35: `tuning.births.coast_s`: `coast_s` is a user's field: write it in `[births]`",
    );
}

#[test]
fn an_unknown_field_is_refused_with_the_place_of_the_nearest() {
    check(
        TUNED,
        "[smoothing]\ncutof_hz = 2.0",
        "34: `smoothing.cutof_hz`: unknown field `cutof_hz`, did you mean `[tuning] smoothing.cutoff_hz`?",
    );
    check(
        TUNED,
        "[tuning]\nbirths.coasts_s = 2.0",
        "34: `tuning.births.coasts_s`: unknown field `coasts_s`, did you mean `[births] coast_s`?",
    );
}

#[test]
fn every_tuning_field_in_a_users_table_is_refused_with_its_place() {
    let tuning = PARAMETERS.iter().filter(|p| p.audience == Audience::Tuning);
    for (table, name) in tuning.map(|p| (p.table, p.name)) {
        check(
            TUNED,
            &format!("[{table}]\n{name} = 1"),
            &format!("34: `{table}.{name}`: it belongs at `[tuning] {table}.{name}`"),
        );
    }
}
