//! Shared by tests of stops and of limits.
#![allow(dead_code)]

pub mod limits;
pub mod stops;
