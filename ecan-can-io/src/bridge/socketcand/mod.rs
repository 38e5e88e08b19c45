//! socketcand: the ASCII protocol of the daemon of the same name, raw mode only.

mod command;
mod encode;
mod session;

#[cfg(test)]
mod tests;

pub(super) use encode::{encode, encode_losses};
pub(super) use session::SocketcandSession;
