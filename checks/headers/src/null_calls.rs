//! A C test that passes NULL to each pointer that must not be NULL, from the functions themselves.

use std::fmt::Write;
use std::path::Path;

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use quote::ToTokens;
use syn::{Block, FnArg, Item, ItemFn, Pat, Stmt, Type};

use crate::manifest::HEADERS;
use crate::{read, sources};

/// Renders the test from its template.
pub fn test(root: &Path) -> Result<String, String> {
    let template = read(&root.join("checks/headers/templates/null_pointers.c"))?;
    let (mut parts, mut calls) = (String::new(), String::new());
    for header in HEADERS {
        let name = header.name.trim_end_matches(".h");
        let mut body = String::new();
        for entry in header.sections {
            for section in sources::sections(root, entry)? {
                let file = syn::parse_file(&section.text);
                let file = file.map_err(|error| format!("capi/{entry}: {error}"))?;
                for item in &file.items {
                    if let Item::Fn(function) = item {
                        function_calls(&mut body, function);
                    }
                }
            }
        }
        if !body.is_empty() {
            let _ = writeln!(parts, "static void {name}(void)\n{{\n{body}}}\n");
            let _ = writeln!(calls, "    {name}();");
        }
    }
    Ok(template.replace("@PARTS@\n", &parts).replace("@CALLS@\n", &calls))
}

/// Writes a call for each pointer of a function that must not be NULL.
fn function_calls(out: &mut String, function: &ItemFn) {
    let export = function.attrs.iter().find(|attribute| attribute.path().is_ident("export"));
    let Some(export) = export else { return };
    let arguments =
        export.meta.require_list().map(|list| list.tokens.to_string()).unwrap_or_default();
    let parameters: Vec<(String, &Type)> =
        function.sig.inputs.iter().filter_map(parameter).collect();
    let mut checked = checked_pointers(&function.block);
    // The pointer that the attribute enters.
    if ["layer", "bus", "config", "end"].iter().any(|kind| arguments.contains(&format!(", {kind}")))
    {
        let of = arguments
            .split_once("of ")
            .map(|(_, name)| name.split([',', ' ']).next().unwrap_or(name));
        let entered = of.or(parameters.first().map(|(name, _)| name.as_str())).unwrap_or_default();
        checked.push(Checked { pointer: entered.to_owned(), size: None });
    }
    if let Some((_, into)) = arguments.split_once("into ") {
        checked.push(Checked { pointer: into.trim().to_owned(), size: None });
    }
    let failed = arguments.split_once("or ").map(|(_, value)| value.trim().to_owned());
    for (null, _) in
        parameters.iter().filter(|(name, _)| checked.iter().any(|pointer| pointer.pointer == *name))
    {
        let values = parameters.iter().map(|(name, ty)| {
            let is_size = checked.iter().any(|pointer| pointer.size.as_ref() == Some(name));
            match name == null {
                true => "NULL".to_owned(),
                false => value(ty, is_size),
            }
        });
        let call = format!("{}({})", function.sig.ident, values.collect::<Vec<_>>().join(", "));
        let _ = match &failed {
            Some(value) => writeln!(out, "    NONE(ECAN_ERR_NULL, {value}, {call});"),
            None => writeln!(out, "    BAD(ECAN_ERR_NULL, {call});"),
        };
    }
}

fn parameter(argument: &FnArg) -> Option<(String, &Type)> {
    let FnArg::Typed(typed) = argument else { return None };
    let Pat::Ident(name) = &*typed.pat else { return None };
    Some((name.ident.to_string(), &typed.ty))
}

/// A pointer that must not be NULL, with the parameter that is its size.
struct Checked {
    pointer: String,
    size: Option<String>,
}

/// Finds the pointers that a body checks whatever the other arguments are.
fn checked_pointers(body: &Block) -> Vec<Checked> {
    let macros = body.stmts.iter().filter_map(|statement| match statement {
        Stmt::Macro(found) if found.mac.path.is_ident("pointers") => Some(&found.mac.tokens),
        _ => None,
    });
    macros.flat_map(|tokens| macro_pointers(tokens.clone())).collect()
}

/// Pointers of one `pointers!(call, kind(pointer, size), ...)`.
fn macro_pointers(tokens: TokenStream) -> Vec<Checked> {
    let mut found = Vec::new();
    let mut kind = String::new();
    for token in tokens {
        match token {
            TokenTree::Group(group) if group.delimiter() == Delimiter::Parenthesis => {
                let names = group.stream().into_iter().filter_map(|token| match token {
                    TokenTree::Ident(name) => Some(name.to_string()),
                    _ => None,
                });
                let mut names = names.collect::<Vec<_>>().into_iter();
                if let Some(pointer) = names.next().filter(|_| !kind.starts_with("optional")) {
                    found.push(Checked { pointer, size: names.next() });
                }
            }
            token => kind = token.to_string(),
        }
    }
    found
}

/// An argument of another parameter than the tested one.
fn value(ty: &Type, is_size: bool) -> String {
    let Type::Ptr(pointer) = ty else {
        let is_function = ty.to_token_stream().to_string().contains("fn");
        return if is_function {
            "NULL"
        } else if is_size {
            "8"
        } else {
            "0"
        }
        .to_owned();
    };
    match pointer.elem.to_token_stream().to_string().as_str() {
        "c_char" if pointer.mutability.is_none() => "\"x\"",
        "ecan_igh_context_t" => "&igh",
        "igh_mcan_port_t" => "&port",
        "igh_cia402_context_t" => "&motors",
        "ecan_igh_diagnostics_t" => "&diagnostics",
        "ecan_igh_observer_t" => "&observer",
        "ecan_igh_config_t" => "&igh_config",
        "igh_mcan_port_config_t" => "&config",
        "igh_mcan_pdo_writer_t" => "&writer",
        "igh_mcan_pdo_profile_t" => "&profile",
        _ => "memory",
    }
    .to_owned()
}
