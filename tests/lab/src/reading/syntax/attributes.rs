//! Which attributes make code a test.

use syn::{Attribute, ImplItem, Item, Meta, Stmt, TraitItem};

/// Whether one of the attributes is a `#[cfg(...)]` that holds in tests only, or `#[test]` itself.
pub fn are_of_a_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let path = attribute.path();
        if path.is_ident("cfg") {
            let condition = attribute.parse_args::<Meta>();
            return condition.is_ok_and(|condition| holds_in_tests_only(&condition));
        }
        // `#[test]`, `#[tokio::test]`.
        let last = path.segments.last();
        last.is_some_and(|segment| segment.ident == "test")
    })
}

/// Whether a condition of `cfg` cannot hold outside tests: `test`, `all(test, ...)`, `any(test, all(test, ...))`.
fn holds_in_tests_only(condition: &Meta) -> bool {
    let Meta::List(list) = condition else {
        return condition.path().is_ident("test");
    };
    let parser = syn::punctuated::Punctuated::<Meta, syn::Token![,]>::parse_terminated;
    let Ok(parts) = list.parse_args_with(parser) else {
        return false;
    };
    if list.path.is_ident("all") {
        parts.iter().any(holds_in_tests_only)
    } else {
        list.path.is_ident("any") && !parts.is_empty() && parts.iter().all(holds_in_tests_only)
    }
}

/// The file that a `#[path = "..."]` names.
pub fn path_of(attributes: &[Attribute]) -> Option<String> {
    attributes.iter().find_map(|attribute| {
        let Meta::NameValue(pair) = &attribute.meta else {
            return None;
        };
        match &pair.value {
            syn::Expr::Lit(syn::ExprLit {
                lit: syn::Lit::Str(path),
                ..
            }) if pair.path.is_ident("path") => Some(path.value()),
            _ => None,
        }
    })
}

/// The attributes of an item.
pub fn of_item(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(it) => &it.attrs,
        Item::Enum(it) => &it.attrs,
        Item::ExternCrate(it) => &it.attrs,
        Item::Fn(it) => &it.attrs,
        Item::ForeignMod(it) => &it.attrs,
        Item::Impl(it) => &it.attrs,
        Item::Macro(it) => &it.attrs,
        Item::Mod(it) => &it.attrs,
        Item::Static(it) => &it.attrs,
        Item::Struct(it) => &it.attrs,
        Item::Trait(it) => &it.attrs,
        Item::TraitAlias(it) => &it.attrs,
        Item::Type(it) => &it.attrs,
        Item::Union(it) => &it.attrs,
        Item::Use(it) => &it.attrs,
        _ => &[],
    }
}

/// The attributes of an item of an `impl`.
pub fn of_impl_item(item: &ImplItem) -> &[Attribute] {
    match item {
        ImplItem::Const(it) => &it.attrs,
        ImplItem::Fn(it) => &it.attrs,
        ImplItem::Type(it) => &it.attrs,
        ImplItem::Macro(it) => &it.attrs,
        _ => &[],
    }
}

/// The attributes of an item of a trait.
pub fn of_trait_item(item: &TraitItem) -> &[Attribute] {
    match item {
        TraitItem::Const(it) => &it.attrs,
        TraitItem::Fn(it) => &it.attrs,
        TraitItem::Type(it) => &it.attrs,
        TraitItem::Macro(it) => &it.attrs,
        _ => &[],
    }
}

/// The attributes of a statement that may have some; those of an item in a function are the item's.
pub fn of_statement(statement: &Stmt) -> &[Attribute] {
    match statement {
        Stmt::Local(it) => &it.attrs,
        Stmt::Macro(it) => &it.attrs,
        Stmt::Expr(syn::Expr::Block(it), _) => &it.attrs,
        Stmt::Expr(syn::Expr::Call(it), _) => &it.attrs,
        Stmt::Expr(syn::Expr::MethodCall(it), _) => &it.attrs,
        Stmt::Expr(syn::Expr::If(it), _) => &it.attrs,
        _ => &[],
    }
}

#[cfg(test)]
mod tests {
    use super::are_of_a_test;

    fn is_test(item: &str) -> bool {
        let item: syn::Item = syn::parse_str(item).unwrap();
        are_of_a_test(super::of_item(&item))
    }

    #[test]
    fn what_is_built_for_tests_only_is_a_test() {
        for item in [
            "#[cfg(test)] mod tests;",
            "#[cfg(all(test, unix))] use a::b;",
            "#[cfg(any(test, all(unix, test)))] fn f() {}",
            "#[test] fn f() {}",
            "#[tokio::test(flavor = \"multi_thread\")] async fn f() {}",
        ] {
            assert!(is_test(item), "{item}");
        }
    }

    #[test]
    fn what_is_also_built_otherwise_is_none() {
        for item in [
            "mod tests;",
            "#[cfg(any(test, feature = \"a\"))] fn f() {}",
            "#[cfg(not(test))] fn f() {}",
            "#[cfg(feature = \"test\")] fn f() {}",
            "#[cfg_attr(test, derive(Debug))] struct S;",
        ] {
            assert!(!is_test(item), "{item}");
        }
    }
}
