//! The CAN interfaces of Linux, virtual or real (`PF_CAN`, raw sockets).

mod bridge;
mod frame;
mod interface;
mod receive_buffer;

#[cfg(test)]
mod bridge_tests;
#[cfg(test)]
mod frame_tests;

pub use bridge::SocketCanBridge;
pub use interface::SocketCanError;
