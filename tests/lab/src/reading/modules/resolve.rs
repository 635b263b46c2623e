//! From a path in code to the modules it leads to.
//!
//! A path is followed through `use` declarations and re-exports to the module that defines what it names, so
//! that a facade hides no arrow. The modules whose `use` it passed on the way are led to as well.

use std::collections::{BTreeMap, BTreeSet};

use super::tree::{Crate, Module};

/// A module of one of the crates.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ModuleId {
    /// Index of the crate.
    pub crate_index: usize,
    /// Path of the module in it.
    pub path: Vec<String>,
}

impl ModuleId {
    fn child(&self, name: &str) -> Self {
        let mut child = self.clone();
        child.path.push(name.to_owned());
        child
    }

    fn parent(&self) -> Self {
        let mut parent = self.clone();
        parent.path.pop();
        parent
    }
}

/// What a name stands for.
#[derive(Clone, Debug)]
enum Named {
    Module(ModuleId),
    /// An item that this module defines.
    Item(ModuleId),
}

/// `use`s that lead to `use`s: more than any sane code has, and the end of a cycle.
const MAX_DEPTH: usize = 12;

/// Follows paths.
pub struct Resolver<'a> {
    crates: &'a [Crate],
    libraries: BTreeMap<&'a str, usize>,
}

impl<'a> Resolver<'a> {
    /// A resolver for paths in `crates`.
    pub fn new(crates: &'a [Crate]) -> Self {
        let libraries = crates
            .iter()
            .enumerate()
            .filter(|(_, it)| it.library)
            .map(|(index, it)| (it.name.as_str(), index))
            .collect();
        Self { crates, libraries }
    }

    fn module(&self, id: &ModuleId) -> Option<&Module> {
        let module = self.crates[id.crate_index].modules.get(&id.path);
        module.filter(|module| !module.test)
    }

    /// The modules that `path`, written in `from`, leads to; none when it leads out of the workspace.
    pub fn targets(&self, from: &ModuleId, path: &[String]) -> BTreeSet<ModuleId> {
        let mut passed = BTreeSet::new();
        let ends = self.follow(from, path, 0, &mut passed);
        passed.extend(ends.into_iter().map(|end| match end {
            Named::Module(module) | Named::Item(module) => module,
        }));
        passed
    }

    fn follow(
        &self,
        from: &ModuleId,
        path: &[String],
        depth: usize,
        passed: &mut BTreeSet<ModuleId>,
    ) -> Vec<Named> {
        let Some((first, rest)) = path.split_first() else {
            return Vec::new();
        };
        let mut ends = match first.as_str() {
            "crate" => vec![Named::Module(ModuleId {
                crate_index: from.crate_index,
                path: Vec::new(),
            })],
            "self" => vec![Named::Module(from.clone())],
            "super" => vec![Named::Module(from.parent())],
            name => self.look_up(from, name, depth, passed),
        };
        if ends.is_empty()
            && let Some(&crate_index) = self.libraries.get(first.as_str())
        {
            let path = Vec::new();
            ends.push(Named::Module(ModuleId { crate_index, path }));
        }
        for name in rest {
            let step = |end| self.step(end, name, depth, passed);
            ends = ends.into_iter().flat_map(step).collect();
        }
        ends
    }

    fn step(
        &self,
        from: Named,
        name: &str,
        depth: usize,
        passed: &mut BTreeSet<ModuleId>,
    ) -> Vec<Named> {
        // Behind a type or a trait come its own items.
        let Named::Module(module) = from else {
            return vec![from];
        };
        match name {
            "self" => vec![Named::Module(module)],
            "super" => vec![Named::Module(module.parent())],
            _ => {
                let found = self.look_up(&module, name, depth, passed);
                if found.is_empty() {
                    // Made by a macro, most likely.
                    return vec![Named::Item(module)];
                }
                found
            }
        }
    }

    /// What `name` stands for in module `at`, as a type and as a value.
    fn look_up(
        &self,
        at: &ModuleId,
        name: &str,
        depth: usize,
        passed: &mut BTreeSet<ModuleId>,
    ) -> Vec<Named> {
        let Some(module) = self.module(at) else {
            return Vec::new();
        };
        if depth > MAX_DEPTH {
            return Vec::new();
        }
        let mut found = Vec::new();
        let child = at.child(name);
        if self.module(&child).is_some() {
            found.push(Named::Module(child));
        }
        if module.code.items.contains(name) {
            found.push(Named::Item(at.clone()));
        }
        let imports = &module.code.imports;
        for import in imports.iter().filter(|it| it.name.as_deref() == Some(name)) {
            let mut on_the_way = BTreeSet::new();
            let leads = self.follow(at, &import.path, depth + 1, &mut on_the_way);
            if !leads.is_empty() {
                passed.insert(at.clone());
                passed.extend(on_the_way);
                found.extend(leads);
            }
        }
        if !found.is_empty() {
            return found;
        }
        for glob in imports.iter().filter(|it| it.name.is_none()) {
            let mut on_the_way = BTreeSet::from([at.clone()]);
            for end in self.follow(at, &glob.path, depth + 1, &mut on_the_way) {
                if let Named::Module(of) = end {
                    found.extend(self.look_up(&of, name, depth + 1, &mut on_the_way));
                }
            }
            if !found.is_empty() {
                passed.extend(on_the_way);
                break;
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::super::tree::{Crate, Role, tests::files};
    use super::{ModuleId, Resolver};

    /// Two crates, `one` and `two`, which uses `one`.
    fn crates() -> Vec<Crate> {
        let files = files(&[
            (
                "one/lib.rs",
                "pub mod person; pub mod lattice; pub use person::Track;",
            ),
            (
                "one/person/mod.rs",
                "mod birth; mod track; pub use track::*; pub struct Rules; made!();",
            ),
            (
                "one/person/birth.rs",
                "use super::Track; use crate::lattice as search;",
            ),
            ("one/person/track.rs", "pub struct Track; pub fn birth() {}"),
            (
                "one/lattice.rs",
                "use self::round::B; mod round { pub use super::round::B; }",
            ),
            (
                "two/lib.rs",
                "use one::person; fn f() { use one::lattice; }",
            ),
        ]);
        let grow = |name: &str| {
            let root = format!("{name}/lib.rs");
            Crate::grow(name, name, true, Role::Source, &root, &files).unwrap()
        };
        vec![grow("one"), grow("two")]
    }

    /// Where `path` in module `from` of crate `crate_index` leads, as `crate::module`.
    fn targets(crate_index: usize, from: &str, path: &str) -> Vec<String> {
        let crates = crates();
        let split = |text: &str| -> Vec<String> {
            text.split("::")
                .filter(|it| !it.is_empty())
                .map(str::to_owned)
                .collect()
        };
        let from = ModuleId {
            crate_index,
            path: split(from),
        };
        let found = Resolver::new(&crates).targets(&from, &split(path));
        let shown = |id: ModuleId| {
            let name = crates[id.crate_index].name.clone();
            [vec![name], id.path].concat().join("::")
        };
        found.into_iter().map(shown).collect()
    }

    #[test]
    fn crate_self_and_super_are_followed() {
        assert_eq!(
            targets(0, "lattice", "crate::person::Rules"),
            ["one::person"]
        );
        assert_eq!(targets(0, "person", "self::Rules"), ["one::person"]);
        assert_eq!(
            targets(0, "person::birth", "super::super::lattice"),
            ["one::lattice"]
        );
    }

    #[test]
    fn a_re_export_leads_to_where_the_thing_is_defined() {
        let expected = ["one", "one::person", "one::person::track"];
        assert_eq!(targets(0, "lattice", "crate::Track"), expected);
        let expected = ["one::person", "one::person::track"];
        assert_eq!(targets(0, "lattice", "crate::person::Track::new"), expected);
    }

    #[test]
    fn a_name_that_was_imported_leads_on() {
        let expected = ["one::lattice", "one::person::birth"];
        assert_eq!(targets(0, "person::birth", "search::search"), expected);
        let expected = ["one::person", "one::person::track", "two"];
        assert_eq!(targets(1, "", "person::Track"), expected);
        assert_eq!(targets(1, "", "lattice::x"), ["one::lattice", "two"]);
    }

    #[test]
    fn a_name_of_a_module_and_of_a_function_is_both() {
        let expected = ["one::person::birth"];
        assert_eq!(targets(0, "lattice", "crate::person::birth"), expected);
        let expected = ["one::person", "one::person::track"];
        assert_eq!(targets(0, "person::birth", "super::track::birth").len(), 1);
        assert_eq!(targets(0, "lattice", "crate::person::Track"), expected);
    }

    #[test]
    fn what_nobody_wrote_down_is_taken_for_the_work_of_a_macro_there() {
        assert_eq!(
            targets(0, "lattice", "crate::person::Made"),
            ["one::person"]
        );
    }

    #[test]
    fn other_crates_than_ours_lead_nowhere() {
        assert!(targets(0, "lattice", "std::fs::read").is_empty());
        assert!(targets(0, "lattice", "Vec::new").is_empty());
    }

    #[test]
    fn cycles_of_re_exports_end() {
        assert!(targets(0, "lattice", "B::x").len() <= 2);
    }
}
