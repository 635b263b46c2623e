//! Sending of a tick's results to the link and the ring.

use farfield_proto::message::fill::SetKind;

use super::shared::Shared;
use super::tick_start::TickStart;
use crate::live::rate::MessageKind;
use crate::pipeline::EdgeOutput;
use crate::ring::record::Label;

/// Sends and stores the results of `start`. Sightings first: the patches state how many sightings
/// fusion must wait for.
pub(super) fn send(shared: &Shared, start: &TickStart, output: EdgeOutput) {
    let label = |session, kind| Label {
        session,
        tick: start.tick,
        kind,
    };
    for set in &output.sighting_sets {
        let bytes = shared.encode(set);
        shared.keep(label(set.session, SetKind::Sightings), &bytes);
        shared.send(MessageKind::Sightings, bytes);
    }
    let messages = output.patch_sets.len();
    let (mut persons, mut payload) = (0, 0);
    for mut set in output.patch_sets {
        let now_us = shared.clock.now_us();
        set.timing = shared.ledger().timing(start.tick, now_us);
        let bytes = shared.encode(&set);
        shared.keep(label(set.session, SetKind::Patches), &bytes);
        persons += set.persons.len();
        payload += bytes.len();
        if start.may_send {
            shared.send(MessageKind::Patches(start.tick), bytes);
        }
    }
    let mut ledger = shared.ledger();
    ledger
        .rate
        .packed(start.plan.level, persons, messages, payload);
}
