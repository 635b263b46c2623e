//! The plan of ticks for all edges: made once a second, sent with the boxes, and reported.

use farfield_node::process::say;

use super::run::LiveFusion;
use crate::live::Micros;

impl LiveFusion<'_> {
    /// Plans the ticks of all edges from what each edge reports.
    pub(super) fn plan_ticks(&mut self) {
        let now_us = self.interceptor.clock.now_us();
        let needs = self.needs(now_us);
        let needed_nths: Vec<u16> = needs.iter().map(|(_, nth)| *nth).collect();
        self.plan.hear(&needed_nths, now_us);
        let every_nth = self.plan.every_nth();
        for edge in &mut self.edges {
            edge.every_nth_tick = every_nth;
        }
        let slow = needs.iter().filter(|(_, nth)| *nth >= every_nth);
        let slow: Vec<&str> = slow.map(|(name, _)| name.as_str()).collect();
        let words = match (every_nth, slow.is_empty()) {
            (..=1, _) => None,
            // Edges have time again, and the plan follows in a moment: until then the reason is the one of before.
            (_, true) => self.plan_words.clone(),
            (_, false) => Some(self.plan_in_words(&slow)),
        };
        match (&self.plan_words, &words) {
            (None, Some(words)) => say(format_args!("{words}")),
            (Some(_), None) => say(format_args!("the edges work at every tick again")),
            _ => {}
        }
        self.plan_words = words;
    }

    fn plan_in_words(&self, slow: &[&str]) -> String {
        let rate_hz = self.config.venue.rate_hz;
        format!(
            "the edges share ticks at {:.0} of {rate_hz:.0} Hz: more is too much for {}",
            rate_hz / f64::from(self.plan.every_nth()),
            slow.join(", ")
        )
    }

    /// The edges that are there and have people to work on, and the n that each needs: it would work on every n-th tick.
    fn needs(&self, now_us: Micros) -> Vec<(String, u16)> {
        let there = self.members.last_words().filter_map(|status| {
            let index = usize::from(self.config.venue.viewpoint_named(&status.node)?.0);
            let is_there = self.members.is_welcome(index) && self.edges[index].is_heard(now_us);
            let nth = status.live.as_ref().map(|live| live.needed_nth_tick);
            let nth = nth.filter(|nth| is_there && *nth > 0)?;
            Some((status.node.clone(), nth))
        });
        there.collect()
    }
}
