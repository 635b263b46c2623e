//! Finds code that is built for tests only.

/// Paths, without `.rs`, of the modules that a file declares for tests only.
pub(super) fn test_modules(path: &str, text: &str) -> Vec<String> {
    let (folder, file) = path.rsplit_once('/').unwrap_or(("", path));
    let children = match file.strip_suffix(".rs") {
        Some("mod" | "lib" | "main") | None => folder.to_owned(),
        Some(stem) => format!("{folder}/{stem}"),
    };
    let mut modules = Vec::new();
    let (mut is_test, mut named) = (false, None);
    for line in text.lines() {
        if is_test_attribute(line) {
            is_test = true;
        } else if let Some(name) = line.strip_prefix("#[path = \"") {
            named = name.strip_suffix(".rs\"]");
        } else if !line.starts_with("#[") && !line.starts_with("//") {
            let module = line.rsplit_once("mod ").map_or("", |(_, name)| name);
            if let (true, Some(name)) = (is_test, module.strip_suffix(';')) {
                modules.push(match named {
                    Some(named) => format!("{folder}/{named}"),
                    None => format!("{children}/{name}"),
                });
            }
            (is_test, named) = (false, None);
        }
    }
    modules
}

/// By line of a file: whether it is built for tests only.
pub(super) fn test_lines(text: &str) -> Vec<bool> {
    let mut is_test = Vec::new();
    let mut end: Option<String> = None;
    let mut begins = false;
    for line in text.lines() {
        let indentation = &line[..line.len() - line.trim_start().len()];
        let is_inside = end.is_some();
        if end.as_deref() == Some(line) {
            end = None;
        } else if !is_inside && is_test_attribute(line.trim_start()) {
            begins = true;
        } else if begins && line.ends_with('{') {
            (begins, end) = (false, Some(format!("{indentation}}}")));
        } else if begins && line.ends_with([';', ',', '}']) {
            begins = false;
            is_test.push(true);
            continue;
        }
        is_test.push(is_inside || begins || end.is_some());
    }
    is_test
}

fn is_test_attribute(line: &str) -> bool {
    line.starts_with("#[cfg(test)]") || line.starts_with("#[cfg(all(test") || line == "#[test]"
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "//! Head.

#[cfg(test)]
mod tests;
mod child;

#[cfg(test)]
#[path = \"a_tests.rs\"]
mod more;

pub fn seen() -> usize {
    #[cfg(test)]
    count();
    3
}

#[cfg(test)]
/// Only for tests.
mod inside {
    fn unseen() {}
}

struct Last;
";

    #[test]
    fn modules_for_tests_only_have_the_path_that_rust_looks_for() {
        assert_eq!(
            test_modules("edge/src/rate.rs", TEXT),
            ["edge/src/rate/tests", "edge/src/a_tests"]
        );
        assert_eq!(
            test_modules("edge/src/rate/mod.rs", TEXT),
            ["edge/src/rate/tests", "edge/src/rate/a_tests"]
        );
    }

    #[test]
    fn lines_of_tests_end_with_the_item_that_the_attribute_is_on() {
        let is_test = test_lines(TEXT);
        let numbers = is_test.iter().enumerate().filter(|(_, it)| **it);
        let numbers: Vec<usize> = numbers.map(|(index, _)| index + 1).collect();
        assert_eq!(numbers, [3, 4, 7, 8, 9, 12, 13, 17, 18, 19, 20, 21]);
    }
}
