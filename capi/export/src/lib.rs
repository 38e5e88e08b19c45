//! The attribute of exported C functions.

use proc_macro::TokenStream;
use quote::{ToTokens as _, quote};
use syn::parse::{Parse, ParseStream};
use syn::{
    Expr, ExprIf, FnArg, Ident, ItemFn, Pat, ReturnType, Stmt, Token, Type, parse_macro_input,
};

/// Exports a function to C. The header generator reads the attribute, too.
///
/// The body returns a `Result` with an `ecan_result_t` as error; a body without a value succeeds. No
/// panic leaves it. A function without a return type returns the code to C; `or VALUE` is the value
/// of an error for other return types.
///
/// The first argument names the `Call` in the body. The second one enters the pointer that is the
/// first parameter, or the one after `of`: `layer PATTERN` and `bus PATTERN` a context with its layer or its whole object,
/// `config PATTERN` a configuration to change, `end PATTERN` an object whose context ends, if there
/// is one. `into PARAMETER` stores the value of the body.
///
/// ```text
/// #[export(call, layer adapter)]
/// pub fn ecan_igh_activate(context: *mut ecan_igh_context_t) {
///     adapter.activate().or_code(call)
/// }
/// ```
#[proc_macro_attribute]
pub fn export(arguments: TokenStream, item: TokenStream) -> TokenStream {
    let arguments = parse_macro_input!(arguments as Arguments);
    let function = parse_macro_input!(item as ItemFn);
    arguments.expand(function).unwrap_or_else(syn::Error::into_compile_error).into()
}

struct Arguments {
    call: Pat,
    entered: Option<(Ident, Pat)>,
    failed: Option<Expr>,
    into: Option<Ident>,
    of: Option<Ident>,
}

impl Parse for Arguments {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let call = Pat::parse_single(input)?;
        let mut arguments = Self { call, entered: None, failed: None, into: None, of: None };
        while input.parse::<Option<Token![,]>>()?.is_some() {
            let key: Ident = input.parse()?;
            match key.to_string().as_str() {
                "layer" | "bus" | "config" | "end" => {
                    arguments.entered = Some((key, Pat::parse_single(input)?));
                }
                "or" => arguments.failed = Some(input.parse()?),
                "into" => arguments.into = Some(input.parse()?),
                "of" => arguments.of = Some(input.parse()?),
                _ => {
                    return Err(syn::Error::new(
                        key.span(),
                        "allowed: layer, bus, config, end, of, or, into",
                    ));
                }
            }
        }
        Ok(arguments)
    }
}

impl Arguments {
    fn expand(self, function: ItemFn) -> syn::Result<proc_macro2::TokenStream> {
        let ItemFn { attrs, vis, sig, mut block } = function;
        let (name, parameters, call) = (&sig.ident, &sig.inputs, &self.call);
        let returns_code = matches!(sig.output, ReturnType::Default);
        let output = match &sig.output {
            ReturnType::Default => quote!(-> ::std::ffi::c_int),
            output => quote!(#output),
        };
        let is_end = self.entered.as_ref().is_some_and(|(kind, _)| kind == "end");
        let has_value =
            matches!(block.stmts.last(), Some(Stmt::Expr(value, None)) if !is_unit(value));
        if returns_code && self.into.is_none() && !is_end && !has_value {
            block.stmts.push(syn::parse_quote!(return Ok(());));
        }
        let text = name.to_string();
        let body = match &self.entered {
            None => {
                let function = match (&self.failed, returns_code) {
                    (Some(failed), _) => quote!(getter_or(#text, #failed, |#call| #block)),
                    (None, true) => quote!(call(#text, |#call| #block)),
                    (None, false) => quote! {
                        getter(#text, ecan_mcan_host::common::result::ecan_result_t::code, |#call| #block)
                    },
                };
                quote!(::ecan_mcan_host::boundary::#function)
            }
            Some((kind, pattern)) => {
                let context = match (&self.of, parameters.first()) {
                    (Some(of), _) => quote!(#of),
                    (None, Some(FnArg::Typed(first))) => first.pat.to_token_stream(),
                    _ => return Err(syn::Error::new(name.span(), "needs a pointer")),
                };
                let work = quote!(|#call, #pattern| #block);
                if kind == "end" {
                    quote!(unsafe { crate::entry::Entry::new(#text, #context) }.end(|#pattern| #block))
                } else if kind == "config" {
                    quote!(unsafe { crate::entry::Change::new(#text, #context) }.with(#work))
                } else {
                    let entry = quote!(unsafe { crate::entry::Entry::new(#text, #context) });
                    match (&self.into, &self.failed, kind == "bus", returns_code) {
                        (Some(out), ..) => quote! {
                            unsafe { crate::entry::EntryInto::new(#entry, stringify!(#out), #out) }.fill(#work)
                        },
                        (_, Some(failed), ..) => quote!(#entry.get_or(#failed, #work)),
                        (_, _, true, true) => quote!(#entry.on_bus(#work)),
                        (_, _, true, false) => quote!(#entry.get_on_bus(#work)),
                        (_, _, false, true) => quote!(#entry.run(#work)),
                        (_, _, false, false) => quote!(#entry.get(#work)),
                    }
                }
            }
        };
        let has_pointer = parameters.iter().any(
            |parameter| matches!(parameter, FnArg::Typed(typed) if matches!(*typed.ty, Type::Ptr(_))),
        );
        let unsafety = has_pointer.then(|| quote!(unsafe));
        Ok(quote! {
            #(#attrs)*
            #[unsafe(no_mangle)]
            #vis #unsafety extern "C" fn #name(#parameters) #output { #body }
        })
    }
}

/// Returns true for an expression that needs no semicolon after it and has no value.
fn is_unit(value: &Expr) -> bool {
    matches!(value, Expr::If(ExprIf { else_branch: None, .. }) | Expr::ForLoop(_))
}
