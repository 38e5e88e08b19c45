//! Sources as cbindgen reads them: each `mirror!` replaced by the type that it declares, and each
//! function with the attribute `export` by its C function.

use proc_macro2::{TokenStream, TokenTree};
use quote::{ToTokens, quote};
use syn::parse::{Parse, ParseStream};
use syn::{
    Attribute, Expr, File, Ident, Item, ReturnType, Token, Type, Visibility, braced, parse_quote,
    token,
};

pub fn expand(source: &str) -> syn::Result<File> {
    let mut file = syn::parse_file(source)?;
    for item in &mut file.items {
        match item {
            Item::Macro(found) if found.mac.path.is_ident("mirror") => {
                *item = found.mac.parse_body::<Mirror>()?.0;
            }
            Item::Fn(function) => {
                let export = function.attrs.iter_mut().find(|attr| attr.path().is_ident("export"));
                let Some(export) = export else { continue };
                *export = parse_quote!(#[unsafe(no_mangle)]);
                function.sig.abi = Some(parse_quote!(extern "C"));
                if matches!(function.sig.output, ReturnType::Default) {
                    function.sig.output = parse_quote!(-> c_int);
                }
            }
            _ => {}
        }
    }
    Ok(file)
}

/// Names of the C types that a source declares.
pub fn types(file: &File) -> Vec<String> {
    let names = file.items.iter().filter_map(|item| match item {
        Item::Struct(item) => Some(item.ident.to_string()),
        Item::Enum(item) => Some(item.ident.to_string()),
        _ => None,
    });
    names.filter(|name| name.ends_with("_t")).collect()
}

pub fn text(file: &File) -> String {
    file.to_token_stream().to_string()
}

struct Mirror(Item);

impl Parse for Mirror {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let attributes = input.call(Attribute::parse_outer)?;
        let visibility: Visibility = input.parse()?;
        let is_struct = input.peek(Token![struct]);
        input.parse::<TokenTree>()?;
        let name: Ident = input.parse()?;
        while !input.peek(token::Brace) {
            input.parse::<TokenTree>()?;
        }
        let body;
        braced!(body in input);
        let mut members = Vec::new();
        while !body.is_empty() {
            members.push(if is_struct { field(&body)? } else { value(&body)? });
            // What follows is the conversion.
            while !body.is_empty() && !body.peek(Token![,]) {
                body.parse::<TokenTree>()?;
            }
            body.parse::<Option<Token![,]>>()?;
        }
        Ok(Self(if is_struct {
            parse_quote! { #[repr(C)] #(#attributes)* #visibility struct #name { #(#members,)* } }
        } else {
            parse_quote! { #[repr(C)] #(#attributes)* #visibility enum #name { #(#members,)* } }
        }))
    }
}

fn field(body: ParseStream<'_>) -> syn::Result<TokenStream> {
    let attributes = body.call(Attribute::parse_outer)?;
    let (name, _, ty): (Ident, Token![:], Type) = (body.parse()?, body.parse()?, body.parse()?);
    Ok(quote! { #(#attributes)* pub #name: #ty })
}

fn value(body: ParseStream<'_>) -> syn::Result<TokenStream> {
    let attributes = body.call(Attribute::parse_outer)?;
    let (name, _, number): (Ident, Token![=], Expr) = (body.parse()?, body.parse()?, body.parse()?);
    Ok(quote! { #(#attributes)* #name = #number })
}
