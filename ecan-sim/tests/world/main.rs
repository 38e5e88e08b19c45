//! Tests of nodes and recordings in a simulated world.

mod attached_node;
#[path = "../ecrt_support/mod.rs"]
mod ecrt_support;
mod nodes;
mod recording;
