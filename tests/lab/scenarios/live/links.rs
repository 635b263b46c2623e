//! Links that double and reorder what they carry, and links that are cut.

use std::collections::BTreeSet;

use farfield_lab::relay::Impairment;

use super::stage::LiveStage;
use crate::farfield::poses;

#[test]
fn doubled_and_reordered_messages_change_nobody() {
    let mut stage = LiveStage::open();
    let (before, ids) = (stage.takes(), stage.ids());
    for relay in &stage.live.relays {
        relay.set_both(Impairment {
            duplicate: 0.3,
            reorder: 0.3,
            reorder_us: 40_000,
            delay_us: 5_000,
            ..Impairment::default()
        });
    }
    stage.go_on(4.0);
    assert_eq!(stage.ids(), ids);
    before.assert_flat(&stage.takes());
    let lines = poses(&stage.finish("first"));
    let at: Vec<(i64, u64)> = lines
        .iter()
        .map(|line| {
            let person = line["person"].as_u64().unwrap();
            (line["tick"].as_i64().unwrap(), person)
        })
        .collect();
    assert!(at.is_sorted_by(|a, b| a < b), "a tick was worked on twice");
    let people: BTreeSet<u64> = at.iter().map(|(_, person)| *person).collect();
    assert_eq!(people.len(), ids.len(), "{people:?}");
}
