//! Tests of nodes and recordings in a simulated world.

mod attached_node;
mod nodes;
mod recording;
