//! Courts with a net.

use super::drawing::Drawing;

/// ITF, rule 1: singles court 8.23 m wide; service lines 6.40 m from the net; net 0.914 m high in the middle, posts for doubles
/// 0.914 m outside of the court, 1.07 m high.
pub(super) fn tennis(court: &mut Drawing) {
    let (singles, service) = (0.5 * 8.23, 6.4);
    let [x, y] = court.half_m;
    court.boundary("side_line", "base_line");
    // No line is drawn there: it is where the net meets the ground.
    court.halfway("net_foot", "net_foot");
    court.along_ends("singles_line", singles, 0.0, x);
    court.mark_at_four("singles_corner", 0.0, singles, 0.0);
    court.across_at("service_line", service, singles);
    court.segment("centre_service_line", [-service, 0.0], [service, 0.0]);
    court.mark("service_tee_west", [-service, 0.0, 0.0]);
    court.mark("service_tee_east", [service, 0.0, 0.0]);
    court.mark_at_ends("centre_mark", 0.0);
    court.mark("net_top_centre", [0.0, 0.0, 0.914]);
    court.mark("net_post_top_north", [0.0, y + 0.914, 1.07]);
    court.mark("net_post_top_south", [0.0, -y - 0.914, 1.07]);
}

/// FIVB, rule 1: attack lines whose rear edge is 3 m from the axis of the centre line.
pub(super) fn volleyball(court: &mut Drawing) {
    let y = court.half_m[1];
    court.boundary("side_line", "end_line");
    court.halfway("centre_line", "centre_line");
    court.across_at("attack_line", 3.0, y);
}
