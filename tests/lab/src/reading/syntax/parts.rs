//! What a file of Rust consists of, as far as anybody here asks.

use std::collections::BTreeSet;

use super::imports::Import;

/// A path in code, and where.
#[derive(Clone, Debug)]
pub struct Mention {
    /// Its names, as written: `["crate", "venue", "Venue"]`.
    pub path: Vec<String>,
    /// Line, from 1.
    pub line: usize,
}

/// A `mod x;` or `mod x { ... }`.
#[derive(Clone, Debug)]
pub struct Declared {
    /// Name of the module.
    pub name: String,
    /// The file that `#[path]` names.
    pub path: Option<String>,
    /// Whether its code stands in the braces behind it.
    pub inline: bool,
    /// Whether it is there for tests only.
    pub test: bool,
    /// Line, from 1.
    pub line: usize,
}

/// The code of one module, without that of the modules in it, and without tests.
#[derive(Clone, Debug, Default)]
pub struct ModuleCode {
    /// Names of the modules of this file that it stands in, outermost first; empty for the file's own.
    pub inside: Vec<String>,
    /// Whether it is a test. Of a test only what it declares is known.
    pub test: bool,
    /// Modules declared in it.
    pub declared: Vec<Declared>,
    /// Names of the items defined in it.
    pub items: BTreeSet<String>,
    /// What `use` brings in, also inside functions.
    pub imports: Vec<Import>,
    /// Paths of two names or more, except those of `use`.
    pub mentions: Vec<Mention>,
}

/// A function with a body.
#[derive(Clone, Debug)]
pub struct Function {
    /// Its name.
    pub name: String,
    /// Line of its `fn`, from 1.
    pub line: usize,
    /// Lines from its `fn` to its closing brace.
    pub lines: usize,
}

/// A struct, enum, union or trait.
#[derive(Clone, Debug)]
pub struct TypeName {
    /// Its name.
    pub name: String,
    /// Line of the name, from 1.
    pub line: usize,
}
