//! Servers for slcan and socketcand, and slcan on a pseudo-terminal.

mod handshake;
mod queues;
mod terminal;
