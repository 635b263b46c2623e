//! Names that several types or traits share.

use std::collections::BTreeMap;

use super::syntax::code_file::CodeFile;

/// Names of more than one struct, enum, union or trait in `files`, tests left out, with the place of each.
pub fn shared<'a>(files: impl IntoIterator<Item = &'a CodeFile>) -> BTreeMap<&'a str, Vec<String>> {
    let mut places: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for file in files {
        for it in &file.types {
            let place = format!("{}:{}", file.path, it.line);
            places.entry(&it.name).or_default().push(place);
        }
    }
    places.retain(|_, places| places.len() > 1);
    places
}

#[cfg(test)]
mod tests {
    use super::super::modules::tree::tests::files;
    use super::shared;

    #[test]
    fn a_name_of_two_types_is_told_with_both_places() {
        let files = files(&[
            (
                "a.rs",
                "struct Plan;\nmod b { enum Plan {} trait Other {} }",
            ),
            ("b.rs", "#[cfg(test)] mod tests { struct Other; }"),
        ]);
        let shared = shared(files.values());
        let [(name, places)] = &shared.into_iter().collect::<Vec<_>>()[..] else {
            panic!("one name is there twice");
        };
        assert_eq!(
            (*name, &places[..]),
            ("Plan", &["a.rs:1".to_owned(), "a.rs:2".to_owned()][..])
        );
    }
}
