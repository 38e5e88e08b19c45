//! Code that must not allocate.

mod bus;
mod drive;
mod ecrt;
mod gateway;
mod wire;
