//! A CAN interface of Linux with transmit results: the kernel's driver gs_usb on a USB device that
//! this process emulates.
//!
//! The virtual host controller of the kernel (vhci-hcd, USB/IP) exchanges the transfers of the device
//! over a socket pair. The driver echoes a frame to its programs when the device reports it as sent,
//! and returns ENOBUFS to senders while its queue is full.

mod bridge;
mod control;
mod host_frame;
mod usbip;
mod virtual_port;

#[cfg(test)]
mod bridge_tests;

pub use bridge::UsbCanBridge;
