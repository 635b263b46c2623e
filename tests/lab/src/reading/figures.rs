//! Figures of the project's code with their goals.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::path::Path;

use super::{RustFile, Workspace};

/// Most lines of a file without its tests: a longer one has a second subject.
pub const MAX_FILE_LINES: usize = 700;
/// Most Rust files of a folder that a reader can survey.
pub const MAX_FILES_OF_FOLDER: usize = 20;
/// A file with fewer lines is small and may be part of another.
const SMALL_FILE_LINES: usize = 60;
/// Words of the private dialect that plain English replaces.
const DIALECT: [&str; 7] = [
    "told", "said", "whom", "whoever", "nobody", "somebody", "beside",
];

/// The figures of a workspace, for display.
pub struct Figures<'a>(pub &'a Workspace);

impl Display for Figures<'_> {
    fn fmt(&self, text: &mut Formatter<'_>) -> fmt::Result {
        write_lines(text, self.0)?;
        let workspace = self.0;
        let source = || workspace.files.iter().filter(|file| !is_test_file(file));
        let small = source().filter(|file| is_small(file)).count();
        let longest = source()
            .map(|file| file.source().count())
            .max()
            .unwrap_or(0);
        let full = full_folders(workspace);
        let full_name = format!("folders of more than {MAX_FILES_OF_FOLDER} files");
        let constants = |of: &str| {
            let own = workspace
                .files
                .iter()
                .filter(|file| file.path.starts_with(of));
            count(own, is_numeric_constant)
        };
        let all = &workspace.files;
        let pairs = count(all, is_tuple_parameter);
        let wordings = all
            .iter()
            .flat_map(RustFile::tests)
            .filter(|(_, line)| line.contains(".contains(\""));
        let words = |path: &str| {
            let text = workspace.texts.get(path);
            text.map_or(0, |text| text.split_whitespace().count())
        };
        let markdown = workspace.texts.keys().filter(|path| is_markdown(path));
        let markdown: usize = markdown.map(|path| words(path)).sum();
        let architecture = workspace.texts.get("ARCHITECTURE.md");
        let widest = architecture.map(|text| text.lines().map(|line| line.chars().count()).max());
        let rows: [(&str, String, &str); 11] = [
            ("files", all.len().to_string(), "1,150"),
            ("small files", small.to_string(), "50"),
            ("longest file", longest.to_string(), "700"),
            (&full_name, full.len().to_string(), "0"),
            (
                "numeric constants, fusion",
                constants("fusion/").to_string(),
                "480",
            ),
            ("numeric constants", constants("").to_string(), "1,950"),
            ("tuple parameters", pairs.to_string(), "40"),
            ("tests of wording", wordings.count().to_string(), "80"),
            ("words of Markdown", markdown.to_string(), "36,000"),
            (
                "widest line of ARCHITECTURE.md",
                widest.flatten().unwrap_or(0).to_string(),
                "120",
            ),
            (
                "words of CHANGELOG.md",
                words("CHANGELOG.md").to_string(),
                "500",
            ),
        ];
        for (name, value, goal) in rows {
            writeln!(text, "{name:<32} {value:>8}    goal <= {goal}")?;
        }
        writeln!(
            text,
            "{:<32} {:>8.1}    goal < 5",
            "dialect, per 1,000 comment lines",
            dialect_per_thousand(workspace)
        )
    }
}

fn write_lines(text: &mut Formatter<'_>, workspace: &Workspace) -> fmt::Result {
    writeln!(
        text,
        "{:<20} {:>8} {:>8} {:>8}",
        "lines", "source", "tests", "#[test]"
    )?;
    let manifests = workspace.texts.keys();
    let packages: Vec<&str> = manifests
        .filter_map(|path| path.strip_suffix("/Cargo.toml"))
        .collect();
    let mut folders: BTreeMap<&str, [usize; 3]> = BTreeMap::new();
    for file in &workspace.files {
        let is_of = |package: &&str| {
            let rest = file.path.strip_prefix(*package);
            rest.is_some_and(|rest| rest.starts_with('/'))
        };
        let own = packages.iter().copied().filter(is_of);
        let own = own.max_by_key(|package| package.len()).unwrap_or(".");
        let tests = file.text.lines().filter(|line| line.trim() == "#[test]");
        let counts = [file.source().count(), file.tests().count(), tests.count()];
        for of in [own, "all"] {
            let sums = folders.entry(of).or_default();
            for (sum, n) in sums.iter_mut().zip(counts) {
                *sum += n;
            }
        }
    }
    for (folder, [source, tests, n]) in folders {
        writeln!(text, "{folder:<20} {source:>8} {tests:>8} {n:>8}")?;
    }
    writeln!(text)
}

fn count<'a>(files: impl IntoIterator<Item = &'a RustFile>, is: impl Fn(&str) -> bool) -> usize {
    let lines = files.into_iter().flat_map(RustFile::source);
    lines.filter(|(_, line)| is(line)).count()
}

fn is_test_file(file: &RustFile) -> bool {
    file.source().next().is_none()
}

fn is_small(file: &RustFile) -> bool {
    let is_head = ["mod.rs", "lib.rs", "main.rs"]
        .iter()
        .any(|head| file.path.ends_with(head));
    !is_head && file.text.lines().count() < SMALL_FILE_LINES
}

fn is_markdown(path: &str) -> bool {
    Path::new(path).extension().is_some_and(|it| it == "md")
}

/// Whether a line has a parameter that is taken apart. A `let` with types is none.
fn is_tuple_parameter(line: &str) -> bool {
    line.contains("): (") && !line.contains("|(") && !line.trim_start().starts_with("let ")
}

/// Whether a line defines a named number, or several.
fn is_numeric_constant(line: &str) -> bool {
    const NUMBERS: [&str; 12] = [
        "f64", "f32", "usize", "u64", "u32", "u16", "u8", "i64", "i32", "Micros", "Duration",
        "Range<",
    ];
    let constant = line.split_once("const ");
    let Some((name, kind)) = constant.and_then(|(_, it)| it.split_once(": ")) else {
        return false;
    };
    let is_name = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    let kind = kind.trim_start_matches(['[', '(']);
    let is_parameter = line.contains("<const ");
    !is_parameter
        && name.chars().all(is_name)
        && NUMBERS.iter().any(|number| kind.starts_with(number))
}

/// The folders with more than [`MAX_FILES_OF_FOLDER`] Rust files, and their numbers of files.
pub fn full_folders(workspace: &Workspace) -> Vec<(String, usize)> {
    let mut folders: BTreeMap<&str, usize> = BTreeMap::new();
    for file in &workspace.files {
        let folder = file.path.rsplit_once('/').map_or("", |(folder, _)| folder);
        *folders.entry(folder).or_default() += 1;
    }
    let full = folders
        .into_iter()
        .filter(|(_, n)| *n > MAX_FILES_OF_FOLDER);
    full.map(|(folder, n)| (folder.to_owned(), n)).collect()
}

/// Words of the dialect in all Rust and Markdown files; each word of a longer name counts.
pub fn dialect(workspace: &Workspace) -> usize {
    let ours = |path: &str| is_markdown(path) || super::is_rust(path);
    let texts = workspace.texts.iter().filter(|(path, _)| ours(path));
    texts.map(|(_, text)| dialect_words(text)).sum()
}

fn dialect_words(text: &str) -> usize {
    text.split(|c: char| !c.is_ascii_alphabetic())
        .filter(|word| DIALECT.iter().any(|it| it.eq_ignore_ascii_case(word)))
        .count()
}

fn dialect_per_thousand(workspace: &Workspace) -> f64 {
    let lines = workspace.files.iter().flat_map(|file| file.text.lines());
    let comments = lines.filter_map(|line| line.trim_start().strip_prefix("//"));
    let (mut words, mut n) = (0, 0_usize);
    for comment in comments {
        words += dialect_words(comment);
        n += 1;
    }
    1000.0 * words as f64 / n.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numeric_constants_are_found_by_name_and_type() {
        for line in [
            "const A: f64 = 1.0;",
            "    pub(super) const A_2: [usize; 3] = [1, 2, 3];",
            "const PAIR: (f64, f64) = (1.0, 2.0);",
        ] {
            assert!(is_numeric_constant(line), "{line}");
        }
        for line in [
            "const NAME: &str = \"a\";",
            "fn f<const N: usize>() {",
            "let a: f64 = 1.0;",
        ] {
            assert!(!is_numeric_constant(line), "{line}");
        }
    }

    #[test]
    fn dialect_words_count_in_names_but_not_in_other_words() {
        assert_eq!(
            dialect_words("fn is_told() { besides } // Nobody, beside"),
            3
        );
    }
}
