//! Cycles in a graph of names.

use std::collections::{BTreeMap, VecDeque};

/// Names, and how many mentions lead from each to each other.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    arrows: BTreeMap<String, BTreeMap<String, usize>>,
}

impl Graph {
    /// Adds `mentions` of `to` in `from`.
    pub fn add(&mut self, from: &str, to: &str, mentions: usize) {
        let arrows = self.arrows.entry(from.to_owned()).or_default();
        *arrows.entry(to.to_owned()).or_default() += mentions;
    }
}

/// One cycle.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cycle {
    /// The names in the order of the arrows; the first is also the last.
    pub names: Vec<String>,
    /// Index in `names` from which the arrow with the fewest mentions starts.
    pub thinnest: usize,
}

/// Cycles, shortest first, that have to be cut until none is left: after each one its thinnest arrow is
/// taken out. Of several that are equally short it is the first in the alphabet.
pub fn cycles(mut graph: Graph) -> Vec<Cycle> {
    let mut cycles = Vec::new();
    while let Some(names) = shortest(&graph) {
        let mentions = |pair: &[String]| graph.arrows[&pair[0]][&pair[1]];
        let pairs = names.windows(2).enumerate();
        let thinnest = pairs.min_by_key(|(_, pair)| mentions(pair));
        let thinnest = thinnest.map_or(0, |(index, _)| index);
        if let Some(arrows) = graph.arrows.get_mut(&names[thinnest]) {
            arrows.remove(&names[thinnest + 1]);
        }
        cycles.push(Cycle { names, thinnest });
    }
    cycles
}

fn shortest(graph: &Graph) -> Option<Vec<String>> {
    let found = graph.arrows.keys().filter_map(|name| around(graph, name));
    found.min_by_key(Vec::len)
}

/// The shortest way from `start` back to it, breadth first.
fn around(graph: &Graph, start: &str) -> Option<Vec<String>> {
    let mut came_from: BTreeMap<&str, &str> = BTreeMap::new();
    let mut queue = VecDeque::from([start]);
    while let Some(name) = queue.pop_front() {
        for next in graph.arrows.get(name).into_iter().flat_map(BTreeMap::keys) {
            if next == start {
                let mut way = vec![start.to_owned(), name.to_owned()];
                let mut at = name;
                while at != start {
                    at = came_from[at];
                    way.push(at.to_owned());
                }
                if name == start {
                    way.pop();
                }
                way.reverse();
                return Some(way);
            }
            if !came_from.contains_key(next.as_str()) {
                came_from.insert(next, name);
                queue.push_back(next);
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::{Graph, cycles};

    fn found(arrows: &[(&str, &str, usize)]) -> Vec<(String, usize)> {
        let mut graph = Graph::default();
        for (from, to, mentions) in arrows {
            graph.add(from, to, *mentions);
        }
        let shown = |cycle: super::Cycle| (cycle.names.join(" "), cycle.thinnest);
        cycles(graph).into_iter().map(shown).collect()
    }

    #[test]
    fn a_graph_without_a_cycle_has_none() {
        assert!(found(&[("a", "b", 1), ("a", "c", 1), ("b", "c", 1)]).is_empty());
    }

    #[test]
    fn cycles_come_shortest_first_with_their_thinnest_arrow() {
        let arrows = [
            ("a", "b", 5),
            ("b", "a", 1),
            ("b", "c", 2),
            ("c", "d", 1),
            ("d", "b", 3),
        ];
        let expected = [("a b a".to_owned(), 1), ("b c d b".to_owned(), 1)];
        assert_eq!(found(&arrows), expected);
    }

    #[test]
    fn a_cycle_that_shares_its_cut_is_told_once() {
        let arrows = [("a", "b", 1), ("b", "c", 9), ("c", "a", 9), ("b", "a", 9)];
        assert_eq!(found(&arrows), [("a b a".to_owned(), 0)]);
    }
}
