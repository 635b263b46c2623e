//! The modules of one folder, and the arrows between them.
//!
//! The rule: between the children of a module no arrows run in a cycle, at any depth, so that each folder
//! can be read in an order in which nothing is used before it was read. An arrow from anywhere below one
//! child to anywhere below another counts as one between the two. Arrows between a module and what lies
//! below it do not count, in either direction: a folder's `mod.rs` says what its children share and puts
//! them together, and a child that names its parent's type means that shared part. Since a path is followed
//! to where a thing is defined, a parent that only re-exports something does not hide who it is taken from.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

use super::arrows::Arrow;
use super::cycles::{self, Cycle, Graph};
use super::tree::Crate;

/// The children of one module that know each other.
#[derive(Debug, Default)]
pub struct ModuleFamily<'a> {
    /// The arrows from one child to another.
    pub arrows: BTreeMap<(&'a str, &'a str), Vec<&'a Arrow>>,
}

/// The families by crate index and path of the parent.
pub fn families(arrows: &[Arrow]) -> BTreeMap<(usize, &[String]), ModuleFamily<'_>> {
    let mut families: BTreeMap<(usize, &[String]), ModuleFamily<'_>> = BTreeMap::new();
    for arrow in arrows {
        if arrow.from.crate_index != arrow.to.crate_index {
            continue;
        }
        let (from, to) = (&arrow.from.path, &arrow.to.path);
        let shared = from.iter().zip(to).take_while(|(a, b)| a == b).count();
        if let (Some(one), Some(other)) = (from.get(shared), to.get(shared)) {
            let family = families.entry((arrow.from.crate_index, &from[..shared]));
            let between = family.or_default().arrows.entry((one, other));
            let between = between.or_default();
            // One path can lead to several modules of the other child.
            if !between.last().is_some_and(|it| same_place(it, arrow)) {
                between.push(arrow);
            }
        }
    }
    families
}

fn same_place(one: &Arrow, other: &Arrow) -> bool {
    (&one.file, one.line, &one.path) == (&other.file, other.line, &other.path)
}

/// The places of an arrow that a message shows.
const SHOWN: usize = 4;

/// All cycles of all families, each told with its arrows and their places.
pub fn cycles(crates: &[Crate], arrows: &[Arrow]) -> Vec<String> {
    let mut told = Vec::new();
    for ((crate_index, parent), family) in families(arrows) {
        let mut graph = Graph::default();
        for (&(from, to), places) in &family.arrows {
            graph.add(from, to, places.len());
        }
        let parent = [&[crates[crate_index].name.clone()], parent]
            .concat()
            .join("::");
        for cycle in cycles::cycles(graph) {
            let reported = ReportedCycle {
                parent: &parent,
                cycle: &cycle,
                family: &family,
            };
            told.push(reported.to_string());
        }
    }
    told
}

/// A cycle among the children of `parent`, to be shown.
struct ReportedCycle<'a> {
    parent: &'a str,
    cycle: &'a Cycle,
    family: &'a ModuleFamily<'a>,
}

impl Display for ReportedCycle<'_> {
    fn fmt(&self, text: &mut Formatter<'_>) -> fmt::Result {
        let names = &self.cycle.names;
        writeln!(text, "{}: {}", self.parent, names.join(" -> "))?;
        for (index, pair) in names.windows(2).enumerate() {
            let (from, to) = (pair[0].as_str(), pair[1].as_str());
            let places = self.family.arrows.get(&(from, to));
            let places = places.map_or(&[][..], Vec::as_slice);
            let thinnest = index == self.cycle.thinnest;
            let thinnest = if thinnest { ", the thinnest" } else { "" };
            writeln!(text, "  {from} -> {to}: {}{thinnest}", places.len())?;
            for place in places.iter().take(SHOWN) {
                writeln!(text, "    {}:{}: {}", place.file, place.line, place.path)?;
            }
            if places.len() > SHOWN {
                writeln!(text, "    and {} more", places.len() - SHOWN)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::arrows::arrows;
    use super::super::tree::{Crate, Role, tests::files};

    fn cycles(texts: &[(&str, &str)]) -> Vec<String> {
        let files = files(texts);
        let grown = Crate::grow("p", "p", true, Role::Source, "lib.rs", &files).unwrap();
        let crates = [grown];
        super::cycles(&crates, &arrows(&crates))
    }

    #[test]
    fn two_rooms_that_know_each_other_are_told_with_file_and_line() {
        let told = cycles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a/mod.rs", "mod deep;"),
            ("a/deep.rs", "\nuse crate::b::B;"),
            ("b.rs", "struct B;\n\nfn f() {\n    crate::a::deep::g();\n}"),
        ]);
        let [told] = &told[..] else {
            panic!("{told:?}")
        };
        assert!(told.starts_with("p: a -> b -> a\n"), "{told}");
        assert!(told.contains("    a/deep.rs:2: crate::b::B\n"), "{told}");
        assert!(told.contains("    b.rs:4: crate::a::deep::g\n"), "{told}");
    }

    #[test]
    fn a_facade_does_not_hide_a_cycle() {
        let told = cycles(&[
            ("lib.rs", "mod a;"),
            ("a/mod.rs", "mod b; mod c; pub use c::C;"),
            ("a/b.rs", "use super::C; pub struct B;"),
            ("a/c.rs", "pub struct C(super::b::B);"),
        ]);
        assert!(told[0].starts_with("p::a: b -> c -> b\n"), "{told:?}");
    }

    #[test]
    fn cycles_of_three_are_found() {
        let told = cycles(&[
            ("lib.rs", "mod a; mod b; mod c;"),
            ("a.rs", "use crate::b;"),
            ("b.rs", "use crate::c;"),
            ("c.rs", "use crate::a;"),
        ]);
        assert!(told[0].starts_with("p: a -> b -> c -> a\n"), "{told:?}");
    }

    #[test]
    fn a_child_may_use_what_its_parent_defines() {
        let told = cycles(&[
            ("lib.rs", "mod a;"),
            ("a/mod.rs", "mod b; pub struct A(b::B);"),
            ("a/b.rs", "use super::A; pub struct B; impl A {}"),
        ]);
        assert!(told.is_empty(), "{told:?}");
    }

    #[test]
    fn tests_draw_no_arrows() {
        let told = cycles(&[
            ("lib.rs", "mod a; mod b;"),
            ("a.rs", "use crate::b::B;"),
            (
                "b.rs",
                "pub struct B; #[cfg(test)] mod tests { use crate::a; }",
            ),
        ]);
        assert!(told.is_empty(), "{told:?}");
    }
}
