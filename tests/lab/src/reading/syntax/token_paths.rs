//! Paths in what no parser of ours understands: the arguments of macros and of attributes.

use proc_macro2::{TokenStream, TokenTree};

/// A path and the line on which it begins.
pub type PathAt = (Vec<String>, usize);

/// Appends the paths of at least two names in `tokens` to `found`, also those inside brackets.
pub fn collect(tokens: TokenStream, found: &mut Vec<PathAt>) {
    let mut path: Vec<String> = Vec::new();
    let mut line = 0;
    let mut colons = 0;
    for token in tokens {
        match token {
            TokenTree::Punct(punct) if punct.as_char() == ':' => colons += 1,
            TokenTree::Ident(ident) => {
                if colons != 2 || path.is_empty() {
                    end(&mut path, line, found);
                    line = ident.span().start().line;
                }
                path.push(ident.to_string());
                colons = 0;
            }
            other => {
                end(&mut path, line, found);
                colons = 0;
                if let TokenTree::Group(group) = other {
                    collect(group.stream(), found);
                }
            }
        }
    }
    end(&mut path, line, found);
}

fn end(path: &mut Vec<String>, line: usize, found: &mut Vec<PathAt>) {
    let whole = std::mem::take(path);
    if whole.len() > 1 {
        found.push((whole, line));
    }
}

/// The paths that stand as strings in an attribute: `#[serde(with = "crate::wire::angle")]`.
pub fn collect_quoted(tokens: TokenStream, found: &mut Vec<PathAt>) {
    for token in tokens {
        match token {
            TokenTree::Group(group) => collect_quoted(group.stream(), found),
            TokenTree::Literal(literal) => {
                let line = literal.span().start().line;
                let text = literal.to_string();
                let quoted = text.trim_matches('"');
                if quoted.contains("::")
                    && let Ok(path) = syn::parse_str::<syn::Path>(quoted)
                {
                    let names = path.segments.iter().map(|name| name.ident.to_string());
                    found.push((names.collect(), line));
                }
            }
            _ => {}
        }
    }
}

/// How many `#[test]` and `#[...::test]` there are in `tokens`, also those handed to macros.
pub fn count_tests(tokens: TokenStream) -> usize {
    let mut count = 0;
    let mut after_hash = false;
    for token in tokens {
        if let TokenTree::Group(group) = &token {
            if after_hash && is_test(group.stream()) {
                count += 1;
            }
            count += count_tests(group.stream());
        }
        after_hash = matches!(&token, TokenTree::Punct(punct) if punct.as_char() == '#');
    }
    count
}

/// Whether the inside of an attribute is a path that ends in `test`, with or without arguments.
fn is_test(attribute: TokenStream) -> bool {
    let mut last = None;
    for token in attribute {
        match token {
            TokenTree::Ident(ident) => last = Some(ident),
            TokenTree::Punct(punct) if punct.as_char() == ':' => {}
            TokenTree::Group(_) => break,
            _ => return false,
        }
    }
    last.is_some_and(|name| name == "test")
}

#[cfg(test)]
mod tests {
    use super::{collect, collect_quoted, count_tests};

    fn paths(text: &str) -> Vec<String> {
        let mut found = Vec::new();
        collect(text.parse().unwrap(), &mut found);
        found.iter().map(|(path, _)| path.join("::")).collect()
    }

    #[test]
    fn paths_are_found_at_any_depth_of_brackets() {
        let text = "a, crate::b::c(d::E { x: [super::f] }), y: G::<crate::h>::i, ::j::k";
        let expected = ["crate::b::c", "d::E", "super::f", "crate::h", "j::k"];
        assert_eq!(paths(text), expected);
    }

    #[test]
    fn single_names_are_no_paths() {
        assert!(paths("a b, c = d; e { f }").is_empty());
    }

    #[test]
    fn quoted_paths_of_attributes_are_found() {
        let mut found = Vec::new();
        let text = "(with = \"crate::wire\", rename = \"a b::c\", default = \"f\")";
        collect_quoted(text.parse().unwrap(), &mut found);
        assert_eq!(found, [(vec!["crate".to_owned(), "wire".to_owned()], 1)]);
    }

    #[test]
    fn tests_are_counted_also_inside_macros() {
        let text = "#[test] fn a() {} proptest! { #[test] fn b(x in 0..3) {} } \
            #[tokio::test(x = 1)] async fn c() {} #[cfg(test)] mod t { #[test] #[should_panic] fn d() {} }";
        assert_eq!(count_tests(text.parse().unwrap()), 4);
    }
}
