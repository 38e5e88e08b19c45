//! The attribute of exported C functions.

use proc_macro::TokenStream;
use quote::{ToTokens as _, format_ident, quote};
use syn::parse::{Parse, ParseStream};
use syn::{
    Attribute, Expr, ExprIf, ExprLit, FnArg, Ident, ItemFn, Lit, LitStr, Meta, MetaNameValue, Pat,
    ReturnType, Stmt, Token, Type, parse_macro_input, parse_quote,
};

/// Exports a function to C. The header generator reads the attribute, too.
///
/// The body returns a `Result` with an `ecan_result_t` as error; a body without a value succeeds.
/// A function whose `@usage` begins with "not rt" enters its context for a long call.
/// No panic leaves it. A function without a return type returns the code to C; `or VALUE` is the
/// value of an error for other return types.
///
/// The first argument names the `Call` in the body. The second one enters the pointer that is the
/// first parameter, or the one after `of`: `layer PATTERN` and `bus PATTERN` a context with its
/// layer or its whole object, `config PATTERN` a configuration to change, `end PATTERN` an object
/// whose context ends, if there is one. `into PARAMETER` stores the value of the body.
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
    entered: Option<(String, Pat)>,
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
            match key.to_string() {
                kind if ["layer", "bus", "config", "end"].contains(&kind.as_str()) => {
                    arguments.entered = Some((kind, Pat::parse_single(input)?));
                }
                key if key == "or" => arguments.failed = Some(input.parse()?),
                key if key == "into" => arguments.into = Some(input.parse()?),
                key if key == "of" => arguments.of = Some(input.parse()?),
                // The header generator reads it.
                key if key == "since" => drop(input.parse::<LitStr>()?),
                _ => {
                    let allowed = "allowed: layer, bus, config, end, of, or, into, since";
                    return Err(syn::Error::new(key.span(), allowed));
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
        let (kind, pattern) = self.entered.unzip();
        let returns_code = matches!(sig.output, ReturnType::Default);
        let is_value = |last: &Stmt| matches!(last, Stmt::Expr(value, None) if !is_unit(value));
        let has_value = block.stmts.last().is_some_and(is_value);
        if returns_code && !has_value {
            block.stmts.push(parse_quote!(return Ok(());));
        }
        if let Some(out) = &self.into {
            block = parse_quote!({
                ::ecan_c_boundary::pointers!(call_of_c, out(#out));
                #out.store(#block)
            });
        }
        let context = match (self.of, parameters.first()) {
            (Some(of), _) => of.into_token_stream(),
            (None, Some(FnArg::Typed(first))) => first.pat.to_token_stream(),
            _ => quote!(),
        };
        // SAFETY of the generated calls: C passes NULL or a pointer that is valid for the access of
        // the function, as the introduction of igh_ecan_common.h demands.
        let access = access(&attrs);
        let entered = quote!(unsafe { crate::handle::enter_context(call_of_c, #context, crate::guard::Access::#access)? });
        let enter = match kind.as_deref() {
            Some("layer") => quote! {
                let mut entered = #entered;
                let #pattern = crate::handle::layer_of(#context, call_of_c, &mut entered)?;
            },
            Some("bus") => quote!(let #pattern = &mut #entered;),
            Some("config") => quote! {
                let mut encoded =
                    unsafe { crate::encoded::EncodedCall::encoded_mut(call_of_c, stringify!(#context), #context)? };
                let #pattern = &mut *encoded.value;
            },
            Some(_) => quote! {
                let ended = unsafe { crate::handle::enter_context_to_end(call_of_c, #context)? };
                let Some(#pattern) = ended else { return Ok(()) };
            },
            None => quote!(),
        };
        // A configuration is stored only if the body succeeds.
        if kind.as_deref() == Some("config") {
            block = parse_quote!({
                (|| -> ::core::result::Result<(), ::ecan_c_boundary::result::ecan_result_t> #block)()?;
                return encoded.store(call_of_c);
            });
        }
        let text = name.to_string();
        let body = quote!(|call_of_c| { let #call = call_of_c; #enter #block });
        let body = match (&self.failed, returns_code) {
            (Some(failed), _) => quote!(getter_or(#text, #failed, #body)),
            (None, true) => quote!(call(#text, #body)),
            (None, false) => quote!(code_getter(#text, #body)),
        };
        let output = match &sig.output {
            ReturnType::Default => quote!(-> ::std::ffi::c_int),
            output => output.to_token_stream(),
        };
        let is_pointer = |parameter: &FnArg| match parameter {
            FnArg::Typed(typed) => matches!(*typed.ty, Type::Ptr(_)),
            FnArg::Receiver(_) => false,
        };
        let unsafety = parameters.iter().any(is_pointer).then(|| quote!(unsafe));
        Ok(quote! {
            #(#attrs)*
            #[unsafe(no_mangle)]
            #vis #unsafety extern "C" fn #name(#parameters) #output {
                ::ecan_c_boundary::#body
            }
        })
    }
}

/// Kind of access to the context, by the first property of `@usage` in the doc comment.
fn access(attributes: &[Attribute]) -> Ident {
    let is_long = attributes.iter().any(|attribute| {
        let text = match &attribute.meta {
            Meta::NameValue(MetaNameValue {
                value: Expr::Lit(ExprLit { lit: Lit::Str(text), .. }),
                ..
            }) => text.value(),
            _ => return false,
        };
        text.trim().strip_prefix("@usage").is_some_and(|usage| usage.trim().starts_with("not rt"))
    });
    format_ident!("{}", if is_long { "Long" } else { "Short" })
}

/// Returns true for an expression that needs no semicolon after it and has no value.
fn is_unit(value: &Expr) -> bool {
    matches!(value, Expr::If(ExprIf { else_branch: None, .. }) | Expr::ForLoop(_))
}
