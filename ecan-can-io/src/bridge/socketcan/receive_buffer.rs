//! Receive buffer of a CAN socket in the kernel.

use socketcan::{CanFdSocket, SocketOptions as _};

// Options of `asm-generic/socket.h`.
const SOL_SOCKET: i32 = 1;
const SO_RCVBUF: i32 = 8;
const SO_RCVBUFFORCE: i32 = 33;
const SO_MEMINFO: i32 = 55;
/// Index of the counter of lost frames in the result of `SO_MEMINFO` (`linux/sock_diag.h`).
const DROPS: usize = 8;

/// Requested size in bytes. The kernel counts about 800 bytes for a frame.
const BYTES: i32 = 4 * 1024 * 1024;

/// Enlarges the buffer and counts frames that did not fit.
#[derive(Debug)]
pub(super) struct ReceiveBuffer {
    lost: u32,
}

impl ReceiveBuffer {
    pub(super) fn of(socket: &CanFdSocket) -> Self {
        // Without CAP_NET_ADMIN the kernel limits the size to net.core.rmem_max.
        let forced = socket.set_socket_option_int(SOL_SOCKET, SO_RCVBUFFORCE, BYTES);
        if forced.is_err() {
            let _ = socket.set_socket_option_int(SOL_SOCKET, SO_RCVBUF, BYTES);
        }
        Self { lost: lost(socket) }
    }

    /// Number of frames lost since the last call.
    pub(super) fn newly_lost(&mut self, socket: &CanFdSocket) -> u64 {
        let before = std::mem::replace(&mut self.lost, lost(socket));
        self.lost.wrapping_sub(before).into()
    }
}

/// The kernel's counter of lost frames; 0 if the kernel has none.
fn lost(socket: &CanFdSocket) -> u32 {
    let mut values = [0; 4 * (DROPS + 1)];
    let read = socket.get_socket_option_bytes(SOL_SOCKET, SO_MEMINFO, &mut values);
    let last = values.last_chunk().filter(|_| read.is_ok());
    last.map_or(0, |bytes| u32::from_ne_bytes(*bytes))
}
