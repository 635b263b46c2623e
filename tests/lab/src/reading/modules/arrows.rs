//! Who knows whom: an arrow runs from the module that writes a path to every module the path leads to.

use super::resolve::{ModuleId, Resolver};
use super::tree::{Crate, Role};

/// One mention of another module.
#[derive(Clone, Debug)]
pub struct Arrow {
    /// Where the path is written.
    pub from: ModuleId,
    /// Where it leads.
    pub to: ModuleId,
    /// File of the path.
    pub file: String,
    /// Line of the path, from 1.
    pub line: usize,
    /// The path as written.
    pub path: String,
}

/// All arrows between different modules, outside tests, examples and benches.
pub fn arrows(crates: &[Crate]) -> Vec<Arrow> {
    let resolver = Resolver::new(crates);
    let mut arrows = Vec::new();
    for (crate_index, crate_) in crates.iter().enumerate() {
        if crate_.role != Role::Source {
            continue;
        }
        for (path, module) in crate_.modules.iter().filter(|(_, module)| !module.test) {
            let from = ModuleId {
                crate_index,
                path: path.clone(),
            };
            let imports = module.code.imports.iter().map(|it| (&it.path, it.line));
            let mentions = module.code.mentions.iter().map(|it| (&it.path, it.line));
            for (path, line) in imports.chain(mentions) {
                let others = resolver.targets(&from, path);
                for to in others.into_iter().filter(|to| *to != from) {
                    arrows.push(Arrow {
                        from: from.clone(),
                        to,
                        file: module.file.clone(),
                        line,
                        path: path.join("::"),
                    });
                }
            }
        }
    }
    arrows
}
