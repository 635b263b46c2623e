//! The walk through the syntax of a file that collects what a [`CodeFile`](super::code_file::CodeFile) holds.

use std::ops::RangeInclusive;

use syn::spanned::Spanned as _;
use syn::visit::{self, Visit};
use syn::{Attribute, Item};

use super::attributes;
use super::parts::{Declared, Function, Mention, ModuleCode, TypeName};
use super::{imports, token_paths};

/// What was found so far.
#[derive(Default)]
pub struct Collector {
    /// Lines of items that are tests.
    pub test_lines: Vec<RangeInclusive<usize>>,
    /// The modules, first the file's own.
    pub modules: Vec<ModuleCode>,
    /// Functions outside tests.
    pub functions: Vec<Function>,
    /// Types outside tests.
    pub types: Vec<TypeName>,
    /// Where in `modules` the walk is.
    current: usize,
    /// Whether the walk is in a test.
    test: bool,
}

impl Collector {
    /// Walks through `file`.
    pub fn of(file: &syn::File) -> Self {
        let test = attributes::are_of_a_test(&file.attrs);
        let own = ModuleCode {
            test,
            ..ModuleCode::default()
        };
        let mut collector = Self {
            modules: vec![own],
            test,
            ..Self::default()
        };
        collector.visit_file(file);
        collector
    }

    fn module(&mut self) -> &mut ModuleCode {
        &mut self.modules[self.current]
    }

    /// Visits what has `attributes` and lies on `lines`, and remembers it when it is a test.
    fn enter(
        &mut self,
        attributes: &[Attribute],
        lines: impl FnOnce() -> RangeInclusive<usize>,
        visit: impl FnOnce(&mut Self),
    ) {
        let outer = self.test;
        if !outer && attributes::are_of_a_test(attributes) {
            self.test = true;
            self.test_lines.push(lines());
        }
        visit(self);
        self.test = outer;
    }

    fn mention(&mut self, path: Vec<String>, line: usize) {
        if !self.test && path.len() > 1 {
            self.module().mentions.push(Mention { path, line });
        }
    }

    fn define(&mut self, name: &syn::Ident) {
        if !self.test {
            let name = name.to_string();
            self.module().items.insert(name);
        }
    }

    fn define_type(&mut self, name: &syn::Ident) {
        self.define(name);
        if !self.test {
            self.types.push(TypeName {
                name: name.to_string(),
                line: name.span().start().line,
            });
        }
    }

    fn function(&mut self, signature: &syn::Signature, body: &syn::Block) {
        if !self.test {
            let line = signature.span().start().line;
            let end = body.brace_token.span.close().end().line;
            self.functions.push(Function {
                name: signature.ident.to_string(),
                line,
                lines: end + 1 - line,
            });
        }
    }

    fn declare(&mut self, item: &syn::ItemMod) {
        let declared = Declared {
            name: item.ident.to_string(),
            path: attributes::path_of(&item.attrs),
            inline: item.content.is_some(),
            test: self.test,
            line: item.ident.span().start().line,
        };
        self.module().declared.push(declared);
    }
}

fn lines(node: &impl syn::spanned::Spanned) -> RangeInclusive<usize> {
    let span = node.span();
    span.start().line..=span.end().line
}

impl<'ast> Visit<'ast> for Collector {
    fn visit_item(&mut self, item: &'ast Item) {
        let visit = |walk: &mut Self| {
            match item {
                Item::Const(it) => walk.define(&it.ident),
                Item::Static(it) => walk.define(&it.ident),
                Item::Type(it) => walk.define(&it.ident),
                Item::Fn(it) => walk.define(&it.sig.ident),
                Item::Macro(it) => it.ident.iter().for_each(|name| walk.define(name)),
                Item::Enum(it) => walk.define_type(&it.ident),
                Item::Struct(it) => walk.define_type(&it.ident),
                Item::Union(it) => walk.define_type(&it.ident),
                Item::Trait(it) => walk.define_type(&it.ident),
                _ => {}
            }
            visit::visit_item(walk, item);
        };
        self.enter(attributes::of_item(item), || lines(item), visit);
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        self.declare(item);
        let outer = self.current;
        if item.content.is_some() {
            let mut inside = self.module().inside.clone();
            inside.push(item.ident.to_string());
            self.modules.push(ModuleCode {
                inside,
                test: self.test,
                ..ModuleCode::default()
            });
            self.current = self.modules.len() - 1;
        }
        visit::visit_item_mod(self, item);
        self.current = outer;
    }

    fn visit_impl_item(&mut self, item: &'ast syn::ImplItem) {
        let visit = |walk: &mut Self| visit::visit_impl_item(walk, item);
        self.enter(attributes::of_impl_item(item), || lines(item), visit);
    }

    fn visit_trait_item(&mut self, item: &'ast syn::TraitItem) {
        let visit = |walk: &mut Self| visit::visit_trait_item(walk, item);
        self.enter(attributes::of_trait_item(item), || lines(item), visit);
    }

    fn visit_stmt(&mut self, statement: &'ast syn::Stmt) {
        let visit = |walk: &mut Self| visit::visit_stmt(walk, statement);
        self.enter(
            attributes::of_statement(statement),
            || lines(statement),
            visit,
        );
    }

    fn visit_field(&mut self, field: &'ast syn::Field) {
        let visit = |walk: &mut Self| visit::visit_field(walk, field);
        self.enter(&field.attrs, || lines(field), visit);
    }

    fn visit_field_value(&mut self, field: &'ast syn::FieldValue) {
        let visit = |walk: &mut Self| visit::visit_field_value(walk, field);
        self.enter(&field.attrs, || lines(field), visit);
    }

    fn visit_variant(&mut self, variant: &'ast syn::Variant) {
        let visit = |walk: &mut Self| visit::visit_variant(walk, variant);
        self.enter(&variant.attrs, || lines(variant), visit);
    }

    fn visit_arm(&mut self, arm: &'ast syn::Arm) {
        let visit = |walk: &mut Self| visit::visit_arm(walk, arm);
        self.enter(&arm.attrs, || lines(arm), visit);
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.function(&item.sig, &item.block);
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.sig, &item.block);
        visit::visit_impl_item_fn(self, item);
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(body) = &item.default {
            self.function(&item.sig, body);
        }
        visit::visit_trait_item_fn(self, item);
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if !self.test {
            let imports = imports::flatten(&item.tree);
            self.module().imports.extend(imports);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let names = path.segments.iter().map(|it| it.ident.to_string());
        self.mention(names.collect(), path.span().start().line);
        visit::visit_path(self, path);
    }

    /// `pub(in crate::person)` is no use of what it names.
    fn visit_vis_restricted(&mut self, _: &'ast syn::VisRestricted) {}

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        self.visit_path(&call.path);
        let mut found = Vec::new();
        token_paths::collect(call.tokens.clone(), &mut found);
        for (path, line) in found {
            self.mention(path, line);
        }
    }

    fn visit_attribute(&mut self, attribute: &'ast Attribute) {
        if let syn::Meta::List(list) = &attribute.meta {
            let mut found = Vec::new();
            token_paths::collect(list.tokens.clone(), &mut found);
            token_paths::collect_quoted(list.tokens.clone(), &mut found);
            for (path, line) in found {
                self.mention(path, line);
            }
        }
    }
}
