//! One file of Rust, taken apart.

use std::ops::RangeInclusive;

use super::collector::Collector;
use super::parts::{Function, ModuleCode, TypeName};
use super::{attributes, token_paths};
use crate::reading::ReadError;

/// One file of Rust. Lengths and lists are without its tests.
#[derive(Clone, Debug)]
pub struct CodeFile {
    /// Path from the root of the workspace, with `/`.
    pub path: String,
    /// Its text.
    pub text: String,
    /// Lines of the items that are tests, from 1, in order.
    pub test_lines: Vec<RangeInclusive<usize>>,
    /// Its modules; the first is the file's own.
    pub modules: Vec<ModuleCode>,
    /// Functions, methods and default methods.
    pub functions: Vec<Function>,
    /// Types and traits.
    pub types: Vec<TypeName>,
    /// How many `#[test]`s it has.
    pub tests: usize,
}

impl CodeFile {
    /// Takes `text` apart.
    ///
    /// # Errors
    /// [`ReadError::Syntax`] where it is no Rust.
    pub fn parse(path: &str, text: String) -> Result<Self, ReadError> {
        let fault = |error: syn::Error| ReadError::Syntax {
            path: path.to_owned(),
            line: error.span().start().line,
            what: error.to_string(),
        };
        let tokens: proc_macro2::TokenStream = syn::parse_str(&text).map_err(fault)?;
        let syntax = syn::parse2::<syn::File>(tokens.clone()).map_err(fault)?;
        let collected = Collector::of(&syntax);
        let mut file = Self {
            path: path.to_owned(),
            text,
            test_lines: collected.test_lines,
            modules: collected.modules,
            functions: collected.functions,
            types: collected.types,
            tests: token_paths::count_tests(tokens),
        };
        if attributes::are_of_a_test(&syntax.attrs) {
            file.test_lines = vec![1..=file.text.lines().count()];
        }
        Ok(file)
    }

    /// Whether line `line`, from 1, is part of a test.
    pub fn is_test_line(&self, line: usize) -> bool {
        self.test_lines.iter().any(|range| range.contains(&line))
    }

    /// Number of lines, without tests.
    pub fn lines(&self) -> usize {
        self.text.lines().count() - self.lines_of_tests()
    }

    /// Number of lines of tests.
    pub fn lines_of_tests(&self) -> usize {
        let length = |range: &RangeInclusive<usize>| range.end() + 1 - range.start();
        self.test_lines.iter().map(length).sum()
    }

    /// Every path outside tests, those of `use` too.
    pub fn all_mentions(&self) -> impl Iterator<Item = (&[String], usize)> {
        self.modules.iter().flat_map(|module| {
            let imports = module.imports.iter().map(|it| (&it.path[..], it.line));
            let mentions = module.mentions.iter().map(|it| (&it.path[..], it.line));
            imports.chain(mentions)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::CodeFile;

    const TEXT: &str = "//! Head.

#[cfg(test)]
mod tests;
mod child;

use std::fs;

pub fn seen() -> usize {
    crate::other::called()
}

#[cfg(test)]
/// Only for tests.
mod more {
    use crate::hidden;
    fn unseen() {}
}

#[cfg(test)]
use crate::hidden_too;

struct Last {
    field: crate::venue::Venue,
}
";

    fn parsed() -> CodeFile {
        CodeFile::parse("a.rs", TEXT.to_owned()).unwrap()
    }

    #[test]
    fn code_behind_a_tests_module_near_the_head_is_seen() {
        let file = parsed();
        let functions: Vec<&str> = file.functions.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(functions, ["seen"]);
        assert_eq!((file.functions[0].line, file.functions[0].lines), (9, 3));
        assert_eq!(file.types[0].name, "Last");
        assert!(file.modules[0].items.contains("seen"));
    }

    #[test]
    fn tests_are_left_out_wherever_they_stand() {
        let file = parsed();
        let mentions: Vec<String> = file
            .all_mentions()
            .map(|(path, _)| path.join("::"))
            .collect();
        let expected = ["std::fs", "crate::other::called", "crate::venue::Venue"];
        assert_eq!(mentions, expected);
        assert_eq!(file.test_lines, [3..=4, 13..=18, 20..=21]);
        assert_eq!(file.lines(), TEXT.lines().count() - 10);
        assert!(file.is_test_line(17) && !file.is_test_line(19));
    }

    #[test]
    fn modules_are_told_with_whether_they_are_tests() {
        let file = parsed();
        let declared = file.modules[0].declared.iter();
        let declared: Vec<_> = declared
            .map(|it| (&it.name[..], it.test, it.inline))
            .collect();
        let expected = [
            ("tests", true, false),
            ("child", false, false),
            ("more", true, true),
        ];
        assert_eq!(declared, expected);
    }

    #[test]
    fn a_file_that_is_no_rust_is_refused_with_its_line() {
        let refused = CodeFile::parse("a.rs", "fn a() {}\nfn 3() {}\n".to_owned());
        let said = refused.unwrap_err().to_string();
        assert!(said.starts_with("a.rs:2: "), "{said}");
    }
}
