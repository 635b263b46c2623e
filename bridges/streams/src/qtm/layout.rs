//! By which lists of people a client counts.

use std::sync::Arc;

use super::command::Topic;
use crate::frame::{Frame, Roster};

/// The lists of people that a client read last, by which it counts through data. Lists that it never read are those of the
/// frame.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    markers: Option<Arc<Roster>>,
    bodies: Option<Arc<Roster>>,
    skeletons: Option<Arc<Roster>>,
}

impl Layout {
    /// Whose markers, in which order.
    pub fn markers<'a>(&'a self, frame: &'a Frame) -> &'a Roster {
        self.markers.as_ref().unwrap_or(&frame.roster)
    }

    /// Whose bodies, in which order.
    pub fn bodies<'a>(&'a self, frame: &'a Frame) -> &'a Roster {
        self.bodies.as_ref().unwrap_or(&frame.roster)
    }

    /// Whose skeletons, in which order.
    pub fn skeletons<'a>(&'a self, frame: &'a Frame) -> &'a Roster {
        self.skeletons.as_ref().unwrap_or(&frame.roster)
    }

    /// Takes note that the client has read these parameters of the people of `roster`.
    pub(super) fn read(&mut self, topics: &[Topic], roster: &Arc<Roster>) {
        for topic in topics {
            let list = match topic {
                Topic::Markers => &mut self.markers,
                Topic::Bodies => &mut self.bodies,
                Topic::Skeletons { .. } => &mut self.skeletons,
                Topic::General | Topic::Force | Topic::Nothing => continue,
            };
            *list = Some(Arc::clone(roster));
        }
    }
}
