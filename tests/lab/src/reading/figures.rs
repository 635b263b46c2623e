//! The project's figures, each beside its goal.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display, Formatter};

use super::modules::families;
use super::modules::tree::Role;
use super::sizes::Sizes;
use super::syntax::code_file::CodeFile;
use super::type_names;
use super::workspace::Workspace;

/// The most lines of a file, tests left out: one that is longer has a second subject in it.
pub const MAX_FILE_LINES: usize = 700;
/// The most lines of a function.
pub const MAX_FUNCTION_LINES: usize = 80;
/// The most Rust files of a folder: a reader does not keep more in mind.
pub const MAX_FILES_OF_FOLDER: usize = 20;

/// Lines of a package, or of all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct LineCounts {
    source: usize,
    tests: usize,
    examples: usize,
}

fn lines(workspace: &Workspace, package: Option<&str>) -> LineCounts {
    let own = |role| workspace.files_of(package, role);
    let whole = |role| {
        own(role)
            .map(|file| file.text.lines().count())
            .sum::<usize>()
    };
    let within: usize = own(Role::Source).map(CodeFile::lines_of_tests).sum();
    LineCounts {
        source: own(Role::Source).map(CodeFile::lines).sum(),
        tests: whole(Role::Test) + within,
        examples: whole(Role::Example),
    }
}

/// The folders with more Rust files than [`MAX_FILES_OF_FOLDER`], with how many they have.
pub fn full_folders(workspace: &Workspace) -> Vec<(String, usize)> {
    let mut folders: BTreeMap<String, usize> = BTreeMap::new();
    for path in workspace.files.keys() {
        let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
        *folders.entry(folder.to_owned()).or_default() += 1;
    }
    let full = folders
        .into_iter()
        .filter(|(_, n)| *n > MAX_FILES_OF_FOLDER);
    full.collect()
}

/// The figures of a workspace, to be shown.
pub struct Figures<'a>(pub &'a Workspace);

impl Display for Figures<'_> {
    fn fmt(&self, text: &mut Formatter<'_>) -> fmt::Result {
        write_lines(text, self.0)?;
        write_sizes(text, self.0)?;
        write_shape(text, self.0)?;
        write_cycles(text, self.0)?;
        write_names(text, self.0)
    }
}

fn write_lines(text: &mut Formatter<'_>, workspace: &Workspace) -> fmt::Result {
    writeln!(
        text,
        "{:<20} {:>8} {:>8} {:>8} {:>8}",
        "lines", "source", "tests", "examples", "#[test]"
    )?;
    let packages: BTreeSet<&str> = workspace
        .packages
        .iter()
        .map(|it| it.name.as_str())
        .collect();
    for package in packages.iter().copied().map(Some).chain([None]) {
        let of = lines(workspace, package);
        let roles = [Role::Source, Role::Test, Role::Example];
        let files = roles
            .into_iter()
            .flat_map(|role| workspace.files_of(package, role));
        let tests: usize = files.map(|file| file.tests).sum();
        let name = package.unwrap_or("all");
        writeln!(
            text,
            "{name:<20} {:>8} {:>8} {:>8} {tests:>8}",
            of.source, of.tests, of.examples
        )?;
    }
    let all = lines(workspace, None);
    let ratio = all.tests as f64 / all.source.max(1) as f64;
    writeln!(text, "\ntest : source         {ratio:.2}    goal >= 0.60")
}

fn write_sizes(text: &mut Formatter<'_>, workspace: &Workspace) -> fmt::Result {
    let source = || workspace.files_of(None, Role::Source);
    let files = Sizes::of(source().map(CodeFile::lines));
    let [median, p90, max] = [files.at(0.5), files.at(0.9), files.max()];
    writeln!(
        text,
        "files, lines          median {median}, p90 {p90}, max {max}    goal <= 150 / 350 / {MAX_FILE_LINES}"
    )?;
    let functions = Sizes::of(source().flat_map(|file| file.functions.iter().map(|it| it.lines)));
    let [median, p99, max] = [functions.at(0.5), functions.at(0.99), functions.max()];
    writeln!(
        text,
        "functions, lines      median {median}, p99 {p99}, max {max}    goal <= 9 / 56 / {MAX_FUNCTION_LINES}"
    )
}

fn write_shape(text: &mut Formatter<'_>, workspace: &Workspace) -> fmt::Result {
    let full = full_folders(workspace);
    writeln!(
        text,
        "folders over {MAX_FILES_OF_FOLDER} files {}    goal 0",
        full.len()
    )?;
    for (folder, files) in full {
        writeln!(text, "    {folder}: {files}")?;
    }
    Ok(())
}

fn write_cycles(text: &mut Formatter<'_>, workspace: &Workspace) -> fmt::Result {
    let cycles = families::cycles(&workspace.crates, &workspace.arrows);
    writeln!(text, "cycles                {}    goal 0", cycles.len())?;
    for cycle in cycles {
        let first = cycle.lines().next().unwrap_or_default();
        writeln!(text, "    {first}")?;
    }
    Ok(())
}

fn write_names(text: &mut Formatter<'_>, workspace: &Workspace) -> fmt::Result {
    let shared = type_names::shared(workspace.files_of(None, Role::Source));
    writeln!(text, "type names used twice {}    goal 0", shared.len())?;
    for (name, places) in shared {
        writeln!(text, "    {name} x{}: {}", places.len(), places.join(", "))?;
    }
    Ok(())
}
