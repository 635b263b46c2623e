//! Which file is which module of which crate: `mod` declarations followed from the first file of each target.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use crate::reading::ReadError;
use crate::reading::syntax::code_file::CodeFile;
use crate::reading::syntax::parts::{Declared, ModuleCode};

/// The files of a workspace by path.
pub type Files = BTreeMap<String, CodeFile>;

/// What a crate, or a file, is there for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Libraries and binaries.
    Source,
    /// Tests: test targets, and what is built for tests only.
    Test,
    /// Examples and benches.
    Example,
}

/// One crate, a target of a package.
#[derive(Clone, Debug)]
pub struct Crate {
    /// Name of the package.
    pub package: String,
    /// Its name in code.
    pub name: String,
    /// Whether other crates can use it.
    pub library: bool,
    /// What it is there for.
    pub role: Role,
    /// Its modules by path; the crate's root has the empty one.
    pub modules: BTreeMap<Vec<String>, Module>,
}

/// One module.
#[derive(Clone, Debug)]
pub struct Module {
    /// Path of its file.
    pub file: String,
    /// Whether it is built for tests only.
    pub test: bool,
    /// What stands in it.
    pub code: ModuleCode,
}

impl Crate {
    /// The crate whose first file is `root`.
    ///
    /// # Errors
    /// [`ReadError::NoModule`] when the file of a `mod` is not among `files`.
    pub fn grow(
        package: &str,
        name: &str,
        library: bool,
        role: Role,
        root: &str,
        files: &Files,
    ) -> Result<Self, ReadError> {
        let mut crate_ = Self {
            package: package.to_owned(),
            name: name.replace('-', "_"),
            library,
            role,
            modules: BTreeMap::new(),
        };
        if let Some(file) = files.get(root) {
            let at = FileModule {
                file,
                module: Vec::new(),
                test: false,
                owns_folder: true,
            };
            crate_.add(&at, files)?;
        }
        Ok(crate_)
    }

    fn add(&mut self, at: &FileModule<'_>, files: &Files) -> Result<(), ReadError> {
        for code in &at.file.modules {
            let path = [&at.module[..], &code.inside[..]].concat();
            let test = at.test || code.test;
            for declared in code.declared.iter().filter(|it| !it.inline) {
                let (file, owns_folder) = at.file_of(&code.inside, declared, files)?;
                let mut module = path.clone();
                module.push(declared.name.clone());
                let child = FileModule {
                    file,
                    module,
                    test: test || declared.test,
                    owns_folder,
                };
                self.add(&child, files)?;
            }
            let module = Module {
                file: at.file.path.clone(),
                test,
                code: code.clone(),
            };
            self.modules.insert(path, module);
        }
        Ok(())
    }
}

/// A file as a module.
struct FileModule<'a> {
    file: &'a CodeFile,
    module: Vec<String>,
    test: bool,
    /// Whether its children lie beside it, as those of `mod.rs` and `main.rs` do.
    owns_folder: bool,
}

impl FileModule<'_> {
    /// The file of a module declared inside the inline modules `inside` of this file, and whether its
    /// children lie beside it.
    fn file_of<'f>(
        &self,
        inside: &[String],
        declared: &Declared,
        files: &'f Files,
    ) -> Result<(&'f CodeFile, bool), ReadError> {
        let own = Path::new(&self.file.path);
        let beside = own.parent().unwrap_or(Path::new(""));
        let mut folder = match own.file_stem() {
            Some(stem) if !self.owns_folder => beside.join(stem),
            _ => beside.to_owned(),
        };
        folder.extend(inside);
        let candidates = match &declared.path {
            // Inside an inline module the path counts from that module's folder.
            Some(path) if inside.is_empty() => vec![(beside.join(path), true)],
            Some(path) => vec![(folder.join(path), true)],
            None => vec![
                (folder.join(format!("{}.rs", declared.name)), false),
                (folder.join(&declared.name).join("mod.rs"), true),
            ],
        };
        let found = candidates
            .into_iter()
            .find_map(|(path, owns)| Some((files.get(&plain(&path))?, owns)));
        found.ok_or_else(|| ReadError::NoModule {
            path: self.file.path.clone(),
            line: declared.line,
            name: declared.name.clone(),
        })
    }
}

/// A path with `/` and without `.` and `..`.
pub fn plain(path: &Path) -> String {
    let mut whole = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                whole.pop();
            }
            Component::CurDir => {}
            other => whole.push(other),
        }
    }
    whole.to_string_lossy().replace('\\', "/")
}

#[cfg(test)]
pub(in crate::reading) mod tests {
    use super::{CodeFile, Crate, Files, Role};

    /// Files by path and text.
    pub(in crate::reading) fn files(texts: &[(&str, &str)]) -> Files {
        let parsed = |(path, text): &(&str, &str)| {
            let file = CodeFile::parse(path, (*text).to_owned()).unwrap();
            ((*path).to_owned(), file)
        };
        texts.iter().map(parsed).collect()
    }

    #[test]
    fn modules_are_followed_into_their_files() {
        let files = files(&[
            (
                "src/lib.rs",
                "mod a; mod b { mod c; } #[cfg(test)] mod tests;",
            ),
            ("src/a/mod.rs", "mod d;"),
            ("src/a/d.rs", "mod e;"),
            (
                "src/a/d/e.rs",
                "#[cfg(test)] #[path = \"e_tests.rs\"] mod tests;",
            ),
            ("src/a/d/e_tests.rs", ""),
            ("src/b/c.rs", ""),
            ("src/tests.rs", "mod more;"),
            ("src/tests/more.rs", ""),
        ]);
        let grown = Crate::grow("p", "p-q", true, Role::Source, "src/lib.rs", &files).unwrap();
        assert_eq!(grown.name, "p_q");
        let modules = grown.modules.iter();
        let found: Vec<_> = modules
            .map(|(path, module)| (path.join("::"), &module.file[..], module.test))
            .collect();
        let expected = [
            ("", "src/lib.rs", false),
            ("a", "src/a/mod.rs", false),
            ("a::d", "src/a/d.rs", false),
            ("a::d::e", "src/a/d/e.rs", false),
            ("a::d::e::tests", "src/a/d/e_tests.rs", true),
            ("b", "src/lib.rs", false),
            ("b::c", "src/b/c.rs", false),
            ("tests", "src/tests.rs", true),
            ("tests::more", "src/tests/more.rs", true),
        ];
        let expected = expected.map(|(path, file, test)| (path.to_owned(), file, test));
        assert_eq!(found, expected);
    }

    #[test]
    fn a_module_without_a_file_is_refused_with_its_place() {
        let files = files(&[("src/lib.rs", "\nmod gone;")]);
        let grown = Crate::grow("p", "p", true, Role::Source, "src/lib.rs", &files);
        let said = grown.unwrap_err().to_string();
        assert_eq!(said, "src/lib.rs:2: the file of `mod gone;` is not there");
    }
}
