//! The courts of each sport, drawn by its rules.

use std::f64::consts::FRAC_PI_2;

use super::drawing::Drawing;

/// IFAB, law 1: goals 7.32 x 2.44 m; areas of 16.5 and 5.5 m from the inner edge of the posts;
/// penalty mark at 11 m; circles of 9.15 m; corner arcs of 1 m.
pub(super) fn football(court: &mut Drawing) {
    let (goal, area, small, spot, circle) = (7.32, 16.5, 5.5, 11.0, 9.15);
    court.boundary("touchline", "goal_line");
    court.halfway("halfway_line", "halfway");
    court.circle("centre_circle", [0.0, 0.0], circle);
    court.mark("centre_circle_north", [0.0, circle, 0.0]);
    court.mark("centre_circle_south", [0.0, -circle, 0.0]);
    court.area("penalty_area", area, 0.5 * goal + area);
    court.area("goal_area", small, 0.5 * goal + small);
    court.mark_at_ends("penalty_spot", spot);
    // The part of the circle around the spot that is outside the area.
    court.arcs_inward(
        "penalty_arc",
        spot,
        circle,
        libm::acos((area - spot) / circle),
    );
    court.arcs_in_corners("corner_arc", 1.0);
    court.goals(goal, 2.44);
}

/// FIFA, law 1: goals 3 x 2 m; quarter circles of 6 m about the outer edge of each post (8 cm
/// wide), joined by a line of 3.16 m; penalty marks at 6 and 10 m; centre circle of 3 m; corner
/// arcs of 0.25 m.
pub(super) fn futsal(court: &mut Drawing) {
    let (goal, post, area) = (3.0, 0.08, 6.0);
    let outer = 0.5 * goal + post;
    court.boundary("touchline", "goal_line");
    court.halfway("halfway_line", "halfway");
    court.circle("centre_circle", [0.0, 0.0], 3.0);
    court.mark("centre_circle_north", [0.0, 3.0, 0.0]);
    court.mark("centre_circle_south", [0.0, -3.0, 0.0]);
    court.across_ends("penalty_area_front", area, outer);
    court.arcs_at_posts("penalty_area_arc", outer, area, 0.0);
    court.mark_at_four("penalty_area_front", area, outer, 0.0);
    court.mark_at_four("penalty_area_back", 0.0, outer + area, 0.0);
    court.mark_at_ends("penalty_spot", 6.0);
    court.mark_at_ends("second_penalty_spot", 10.0);
    court.arcs_in_corners("corner_arc", 0.25);
    court.goals(goal, 2.0);
}

/// IHF, rule 1: goals 3 x 2 m; goal area of 6 m and free-throw line of 9 m about the inner edges of
/// the posts, each with a straight part of 3 m; 7 m line of 1 m, 4 m line of 0.15 m.
pub(super) fn handball(court: &mut Drawing) {
    let (goal, area, free) = (3.0, 6.0, 9.0);
    let post = 0.5 * goal;
    court.boundary("side_line", "goal_line");
    court.halfway("centre_line", "centre_line");
    court.across_ends("goal_area_front", area, post);
    court.arcs_at_posts("goal_area_arc", post, area, 0.0);
    court.mark_at_four("goal_area_front", area, post, 0.0);
    court.mark_at_four("goal_area_back", 0.0, post + area, 0.0);
    court.across_ends("free_throw_front", free, post);
    // It ends at the side lines.
    let reach = ((court.half_m[1] - post) / free).min(1.0);
    court.arcs_at_posts("free_throw_arc", post, free, libm::acos(reach));
    court.across_ends("seven_metre_line", 7.0, 0.5);
    court.mark_at_four("seven_metre_line", 7.0, 0.5, 0.0);
    court.across_ends("four_metre_line", 4.0, 0.075);
    court.mark_at_ends("four_metre_line", 4.0);
    court.goals(goal, 2.0);
}

/// FIBA, article 2, all from the inner edge of the boundary lines: centre circle of 1.8 m;
/// free-throw line of 3.6 m whose farther edge is 5.8 m from the end line; restricted area of 4.9
/// m; three points beyond 6.75 m of the point below the basket (1.575 m from the end line) and 0.9
/// m of the side lines; no-charge semicircle of 1.25 m.
pub(super) fn basketball(court: &mut Drawing) {
    let (free, basket, three) = (5.8, 1.575, 6.75);
    court.boundary("side_line", "end_line");
    court.halfway("centre_line", "centre_line");
    court.circle("centre_circle", [0.0, 0.0], 1.8);
    court.area("restricted_area", free, 2.45);
    court.across_ends("free_throw_line", free, 1.8);
    court.mark_at_four("free_throw_line", free, 1.8, 0.0);
    court.arcs_inward("free_throw_circle", free, 1.8, FRAC_PI_2);
    let side = court.half_m[1] - 0.9;
    // On courts narrower than the ends of the arc, only the straight part remains.
    let half = libm::asin((side / three).min(1.0));
    let corner = basket + three * libm::cos(half);
    court.along_ends("three_point_side", side, 0.0, corner);
    court.arcs_inward("three_point_arc", basket, three, half);
    court.mark_at_four("three_point_corner", 0.0, side, 0.0);
    court.mark_at_four("three_point_bend", corner, side, 0.0);
    court.arcs_inward("no_charge_arc", basket, 1.25, FRAC_PI_2);
    court.mark_at_ends("below_basket", basket);
}

/// ITF, rule 1: singles court 8.23 m wide; service lines 6.40 m from the net; net 0.914 m high in
/// the middle, posts for doubles 0.914 m outside of the court, 1.07 m high.
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
