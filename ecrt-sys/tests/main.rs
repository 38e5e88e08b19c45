//! Tests of the binding.

mod abi;
mod fake;
mod loading;
mod static_program;
mod symbols;
