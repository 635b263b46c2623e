//! Ticks as JSON, for programs of other people: kinds 1 and 3 in one, in plain units.

use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;
use serde::Serialize;

use super::text::json;
use super::tick::{TickMessage, TickPerson, sigma_m};

/// A tick as it is written.
#[derive(Serialize)]
#[serde(tag = "type", rename = "tick")]
struct JsonTick<'a> {
    live: bool,
    session: u32,
    tick: Tick,
    at_us: i64,
    persons: Vec<JsonPerson<'a>>,
}

#[derive(Serialize)]
struct JsonPerson<'a> {
    id: u32,
    state: PersonState,
    views: u16,
    viewpoints: Vec<u8>,
    joints_m: Vec<[f64; 3]>,
    sigma_m: Vec<Option<f64>>,
    angles: &'a [f32],
    unobserved: Vec<u8>,
    clamped: Vec<u8>,
}

/// Which bits are set, ascending.
fn bits(of: u64) -> Vec<u8> {
    (0..64).filter(|bit| of >> bit & 1 == 1).collect()
}

/// A length without the digits that single precision has made up.
fn tidy_m(length_m: f32) -> f64 {
    (f64::from(length_m) * 1e4).round() / 1e4
}

/// The JSON of a tick; `angles` has those of every person, in the message's order.
pub fn json_tick(tick: &TickMessage, angles: &[&[f32]]) -> String {
    let person = |(i, person): (usize, &TickPerson)| JsonPerson {
        id: person.id.0,
        state: person.state,
        views: person.views,
        viewpoints: bits(person.viewpoints),
        joints_m: person
            .joints
            .iter()
            .map(|&steps| tick.grid.point_m(steps).map(tidy_m))
            .collect(),
        sigma_m: person
            .sigma
            .iter()
            .map(|&code| sigma_m(code).map(tidy_m))
            .collect(),
        angles: angles.get(i).copied().unwrap_or_default(),
        unobserved: bits(person.unobserved),
        clamped: bits(person.clamped),
    };
    json(&JsonTick {
        live: tick.is_live,
        session: tick.session,
        tick: tick.tick,
        at_us: tick.at_us,
        persons: tick.persons.iter().enumerate().map(person).collect(),
    })
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::PersonId;

    use super::*;
    use crate::protocol::tick::JointGrid;

    #[test]
    fn a_tick_is_written_as_the_manual_says() {
        let tick = TickMessage {
            is_live: true,
            session: 77,
            tick: Tick(1000),
            at_us: 1_767_225_600_000_000,
            grid: JointGrid {
                origin_m: [0.0; 3],
                step_m: 0.001,
            },
            joints: 1,
            persons: vec![TickPerson {
                id: PersonId(3),
                state: PersonState::Tracked,
                views: 4,
                viewpoints: 0b1111,
                unobserved: 1 << 12,
                clamped: 0,
                joints: vec![[0, 0, 950]],
                sigma: vec![6],
            }],
        };
        assert_eq!(
            json_tick(&tick, &[&[0.1]]),
            "{\"type\":\"tick\",\"live\":true,\"session\":77,\"tick\":1000,\"at_us\":1767225600000000,\
             \"persons\":[{\"id\":3,\"state\":\"tracked\",\"views\":4,\"viewpoints\":[0,1,2,3],\
             \"joints_m\":[[0.0,0.0,0.95]],\"sigma_m\":[0.012],\"angles\":[0.1],\"unobserved\":[12],\"clamped\":[]}]}"
        );
    }
}
