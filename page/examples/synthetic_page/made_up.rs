//! A recording that is made up as it is read.

use farfield_page::RecordedMessages;
use farfield_proto::tick::Tick;

use super::messages::Synthetic;

/// A recording that is made up as it is read.
pub(crate) struct MadeUp {
    synthetic: Synthetic,
    ticks: i64,
}

impl MadeUp {
    /// Of ticks 0 to `ticks`.
    pub(crate) fn new(synthetic: Synthetic, ticks: i64) -> Self {
        Self { synthetic, ticks }
    }
}

impl RecordedMessages for MadeUp {
    fn span_us(&self) -> [i64; 2] {
        [
            self.synthetic.tick_us(Tick(0)),
            self.synthetic.tick_us(Tick(self.ticks)),
        ]
    }

    fn read(
        &mut self,
        from_us: i64,
        to_us: i64,
        visit: &mut dyn FnMut(&str, &[u8], i64),
    ) -> Result<(), String> {
        let period_us = self.synthetic.tick_us(Tick(60)) - self.synthetic.tick_us(Tick(0));
        let tick = |us: i64| (us - self.synthetic.tick_us(Tick(0))) * 60 / period_us;
        let (first, last) = (
            (tick(from_us) - 10).max(0),
            (tick(to_us) + 10).min(self.ticks),
        );
        let mut all: Vec<_> = (first..=last)
            .flat_map(|t| self.synthetic.messages(Tick(t)))
            .collect();
        all.sort_by_key(|(_, _, at_us)| *at_us);
        for (key, bytes, at_us) in all {
            if (from_us..to_us).contains(&at_us) {
                visit(&key, &bytes, at_us);
            }
        }
        Ok(())
    }
}
