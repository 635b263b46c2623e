//! Who sends more than fusion takes: said by name, when it begins and when it is over.

use farfield_node::process::say;

/// Messages over its quota in a second from which it is a flood, and no hiccup of the network.
const FLOOD: u64 = 50;

/// The messages of each viewpoint that were over its quota, as last looked at.
#[derive(Debug, Default)]
pub(super) struct FloodWatch(Vec<Watched>);

#[derive(Debug, Clone, Copy, Default)]
struct Watched {
    refused: u64,
    is_told: bool,
}

impl FloodWatch {
    /// Looks, once a second, at how many messages of each viewpoint, `named`, were over its quota since the start.
    pub(super) fn look<'a>(&mut self, named: impl Iterator<Item = (&'a str, u64)>) {
        for (index, (name, refused)) in named.enumerate() {
            if self.0.len() <= index {
                self.0.push(Watched::default());
            }
            let watched = &mut self.0[index];
            let more = refused - watched.refused.min(refused);
            watched.refused = refused;
            let is_flood = more >= FLOOD;
            if is_flood && !watched.is_told {
                say(format_args!(
                    "viewpoint {name} sends more than any edge may: {more} messages were dropped in a second, the others are not held up; look at that box, and make its keys anew if it is in other hands"
                ));
            } else if more == 0 && watched.is_told {
                say(format_args!(
                    "viewpoint {name} sends no more than it may again"
                ));
            }
            watched.is_told = is_flood || (watched.is_told && more > 0);
        }
    }

    /// The viewpoints that flood, by index.
    pub(super) fn flooding(&self) -> impl Iterator<Item = usize> {
        let told = self.0.iter().enumerate().filter(|(_, w)| w.is_told);
        told.map(|(index, _)| index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_told_by_name_and_a_hiccup_is_not() {
        let mut watch = FloodWatch::default();
        let mut look = |refused: [u64; 2]| {
            watch.look(["a", "b"].into_iter().zip(refused));
            watch.flooding().collect::<Vec<_>>()
        };
        assert_eq!(look([FLOOD - 1, 0]), [0; 0]);
        assert_eq!(look([FLOOD - 1, 1000]), [1]);
        assert_eq!(look([FLOOD - 1, 1001]), [1], "it is not over");
        assert_eq!(look([FLOOD - 1, 1001]), [0; 0]);
    }
}
