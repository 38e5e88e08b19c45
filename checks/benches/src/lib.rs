//! Parts of the benchmarks.
//!
//! | module | contents |
//! | --- | --- |
//! | [`measure`] | ratio of two sides that run in turn, and output |
//! | [`null_master`] | master that exchanges nothing |
//! | [`baseline`] | plain C codec with which that of `ecan-protocol` is compared |

pub mod baseline;
pub mod measure;
pub mod null_master;
