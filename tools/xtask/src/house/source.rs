//! One source file: what its modules declare, import and name, tests left out.

use proc_macro2::{Ident, Spacing, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use syn::visit::{self, Visit};
use syn::{Attribute, Expr, ImplItem, Item, ItemMod, ItemUse, Lit, Meta, UseTree};

/// A path as written; the first segment may be `crate`, `self` or `super`.
pub type Segments = Vec<String>;

/// The code of a module, without that of modules inside it.
#[derive(Debug, Default)]
pub struct ModuleCode {
    /// Names of its own items.
    pub items: BTreeSet<String>,
    /// Names that it imports, and what they stand for.
    pub imports: BTreeMap<String, Segments>,
    /// What it imports everything of.
    pub globs: Vec<Segments>,
    /// Every path of two segments and more in its code, and whatever it imports.
    pub named: BTreeSet<Segments>,
    /// Its modules.
    pub children: Vec<Child>,
}

/// A module that another one declares.
#[derive(Debug)]
pub struct Child {
    /// Its name.
    pub name: String,
    /// Its file, where an attribute names it.
    pub path: Option<String>,
    /// Whether it is there in tests only.
    pub is_test: bool,
    /// Its code, if that is not in a file of its own.
    pub body: Option<ModuleCode>,
}

impl ModuleCode {
    /// The code of a file.
    ///
    /// # Errors
    /// What is not Rust.
    pub fn parse(text: &str) -> syn::Result<Self> {
        let file = syn::parse_file(text)?;
        Ok(Self::from_items(&file.items))
    }

    fn from_items(items: &[Item]) -> Self {
        let mut code = Self::default();
        for item in items {
            code.visit_item(item);
        }
        code
    }

    fn add_child_module_unless_inline_test(&mut self, module: &ItemMod) {
        let is_test = is_compiled_for_tests_only(&module.attrs);
        let body = match &module.content {
            Some(_) if is_test => return,
            Some((_, items)) => Some(Self::from_items(items)),
            None => None,
        };
        self.children.push(Child {
            name: module.ident.to_string(),
            path: find_path_attribute(&module.attrs),
            is_test,
            body,
        });
    }

    fn add_imports_of_tree(&mut self, prefix: &[String], tree: &UseTree) {
        match tree {
            UseTree::Path(path) => self.add_imports_of_tree(&[prefix, &[path.ident.to_string()]].concat(), &path.tree),
            UseTree::Name(name) => self.add_import(prefix, &name.ident, None),
            UseTree::Rename(rename) => self.add_import(prefix, &rename.ident, Some(&rename.rename)),
            UseTree::Glob(_) => {
                self.globs.push(prefix.to_vec());
                self.named.insert(prefix.to_vec());
            }
            UseTree::Group(group) => group.items.iter().for_each(|tree| self.add_imports_of_tree(prefix, tree)),
        }
    }

    fn add_import(&mut self, prefix: &[String], name: &Ident, alias: Option<&Ident>) {
        let mut path = prefix.to_vec();
        // `a::{self}` is `a`.
        if name != "self" || prefix.is_empty() {
            path.push(name.to_string());
        }
        let known_as = alias.map(ToString::to_string).or_else(|| path.last().cloned());
        if let Some(known_as) = known_as.filter(|name| name != "_") {
            self.imports.entry(known_as).or_insert_with(|| path.clone());
        }
        self.named.insert(path);
    }
}

impl<'ast> Visit<'ast> for ModuleCode {
    fn visit_item(&mut self, item: &'ast Item) {
        let (attributes, name) = find_attributes_and_name(item);
        if let Item::Mod(module) = item {
            return self.add_child_module_unless_inline_test(module);
        }
        if is_compiled_for_tests_only(attributes) {
            return;
        }
        self.items.extend(name.map(ToString::to_string));
        visit::visit_item(self, item);
    }

    fn visit_impl_item(&mut self, item: &'ast ImplItem) {
        let attributes = match item {
            ImplItem::Const(item) => &item.attrs[..],
            ImplItem::Fn(item) => &item.attrs,
            _ => &[],
        };
        if !is_compiled_for_tests_only(attributes) {
            visit::visit_impl_item(self, item);
        }
    }

    fn visit_item_use(&mut self, item: &'ast ItemUse) {
        if item.leading_colon.is_none() {
            self.add_imports_of_tree(&[], &item.tree);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.leading_colon.is_none() && path.segments.len() > 1 {
            self.named.insert(path.segments.iter().map(|segment| segment.ident.to_string()).collect());
        }
        visit::visit_path(self, path);
    }

    /// What stands in macros and attributes is no syntax tree; paths are found in it by their colons.
    fn visit_token_stream(&mut self, tokens: &'ast TokenStream) {
        let mut path = Segments::new();
        // How many colons came last; of `::` at the beginning of a path, which leads out of the crate, there are two.
        let mut colons = 0;
        let mut end = |path: &mut Segments| {
            let path = std::mem::take(path);
            if path.len() > 1 {
                self.named.insert(path);
            }
        };
        let mut groups = Vec::new();
        for token in tokens.clone() {
            match token {
                TokenTree::Ident(name) => {
                    if colons != 2 {
                        end(&mut path);
                        path.push(name.to_string());
                    } else if !path.is_empty() {
                        path.push(name.to_string());
                    }
                    colons = 0;
                }
                TokenTree::Punct(mark) if mark.as_char() == ':' => {
                    if mark.spacing() == Spacing::Joint || colons == 1 {
                        colons += 1;
                    } else {
                        end(&mut path);
                    }
                }
                other => {
                    end(&mut path);
                    colons = 0;
                    if let TokenTree::Group(group) = other {
                        groups.push(group.stream());
                    }
                }
            }
        }
        end(&mut path);
        for group in &groups {
            self.visit_token_stream(group);
        }
    }
}

/// An item's attributes, and its name if it has one that paths may lead to.
fn find_attributes_and_name(item: &Item) -> (&[Attribute], Option<&Ident>) {
    match item {
        Item::Const(item) => (&item.attrs, Some(&item.ident)),
        Item::Enum(item) => (&item.attrs, Some(&item.ident)),
        Item::Fn(item) => (&item.attrs, Some(&item.sig.ident)),
        Item::Impl(item) => (&item.attrs, None),
        Item::Macro(item) => (&item.attrs, item.ident.as_ref()),
        Item::Mod(item) => (&item.attrs, None),
        Item::Static(item) => (&item.attrs, Some(&item.ident)),
        Item::Struct(item) => (&item.attrs, Some(&item.ident)),
        Item::Trait(item) => (&item.attrs, Some(&item.ident)),
        Item::Type(item) => (&item.attrs, Some(&item.ident)),
        Item::Union(item) => (&item.attrs, Some(&item.ident)),
        Item::Use(item) => (&item.attrs, None),
        _ => (&[], None),
    }
}

/// Whether something is there in tests only.
fn is_compiled_for_tests_only(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|attribute| match &attribute.meta {
        Meta::List(list) => list.path.is_ident("cfg") && requires_test_cfg(list.tokens.clone()),
        _ => false,
    })
}

/// Whether a condition is `test`, or `all` of several with it among them.
fn requires_test_cfg(condition: TokenStream) -> bool {
    let mut is_all = false;
    condition.into_iter().any(|token| match token {
        TokenTree::Ident(word) => {
            is_all = word == "all";
            word == "test"
        }
        TokenTree::Group(group) => is_all && requires_test_cfg(group.stream()),
        TokenTree::Punct(_) | TokenTree::Literal(_) => false,
    })
}

/// The file of `#[path = "file"]`.
fn find_path_attribute(attributes: &[Attribute]) -> Option<String> {
    attributes.iter().find_map(|attribute| match &attribute.meta {
        Meta::NameValue(pair) if pair.path.is_ident("path") => match &pair.value {
            Expr::Lit(literal) => match &literal.lit {
                Lit::Str(text) => Some(text.value()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    })
}
