
use farfield_edge::pipeline::EdgeOutput;
use farfield_proto::wire;

/// Traffic of the edges in a run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Traffic {
    /// Persons, views and ticks.
    pub patches: u64,
    /// Bytes of their maps.
    pub map_bytes: u64,
    /// Bytes of all patch messages.
    pub message_bytes: u64,
    /// Number of messages.
    pub messages: u64,
}

impl Traffic {
    /// Adds the traffic of a tick.
    pub fn add(&mut self, edges: &[EdgeOutput]) {
        for set in edges.iter().flat_map(|edge| &edge.patch_sets) {
            let maps = set.persons.iter().map(|person| person.maps.bytes.len());
            self.patches += set.persons.len() as u64;
            self.map_bytes += maps.sum::<usize>() as u64;
            self.message_bytes += wire::encode(set).len() as u64;
            self.messages += 1;
        }
    }
}
