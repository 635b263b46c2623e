//! `use` declarations, one name at a time.

use syn::UseTree;

/// One name that a `use` brings in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Import {
    /// What it is called here; `None` for `*`.
    pub name: Option<String>,
    /// Where it comes from, without the `*`.
    pub path: Vec<String>,
    /// Line of the name, from 1.
    pub line: usize,
}

/// The imports of a tree of `use`.
pub fn flatten(tree: &UseTree) -> Vec<Import> {
    let mut imports = Vec::new();
    walk(tree, &mut Vec::new(), &mut imports);
    imports
}

fn walk(tree: &UseTree, path: &mut Vec<String>, imports: &mut Vec<Import>) {
    match tree {
        UseTree::Path(part) => {
            path.push(part.ident.to_string());
            walk(&part.tree, path, imports);
            path.pop();
        }
        UseTree::Group(group) => group
            .items
            .iter()
            .for_each(|item| walk(item, path, imports)),
        UseTree::Name(name) => imports.push(named(path, &name.ident, &name.ident)),
        UseTree::Rename(name) => imports.push(named(path, &name.ident, &name.rename)),
        UseTree::Glob(star) => imports.push(Import {
            name: None,
            path: path.clone(),
            line: star.star_token.spans[0].start().line,
        }),
    }
}

/// The import of `ident` from `path`, called `name`. In a group, `self` is what the group hangs on.
fn named(path: &[String], ident: &syn::Ident, name: &syn::Ident) -> Import {
    let line = ident.span().start().line;
    let mut path = path.to_vec();
    let mut name = name.to_string();
    if ident == "self" && !path.is_empty() {
        if name == "self" {
            name = path.last().cloned().unwrap_or_default();
        }
    } else {
        path.push(ident.to_string());
    }
    Import {
        name: Some(name),
        path,
        line,
    }
}

#[cfg(test)]
mod tests {
    use super::flatten;

    #[test]
    fn a_tree_of_uses_is_taken_apart_into_names() {
        let text = "use crate::a::{self, b::{C, D as E}, f::*, g as _};";
        let item: syn::ItemUse = syn::parse_str(text).unwrap();
        let flat = |import: super::Import| {
            let name = import.name.unwrap_or_else(|| "*".to_owned());
            format!("{} = {}", name, import.path.join("::"))
        };
        let found: Vec<String> = flatten(&item.tree).into_iter().map(flat).collect();
        let expected = [
            "a = crate::a",
            "C = crate::a::b::C",
            "E = crate::a::b::D",
            "* = crate::a::f",
            "_ = crate::a::g",
        ];
        assert_eq!(found, expected);
    }
}
