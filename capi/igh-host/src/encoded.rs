//! Configurations in opaque structs of C, as checked bytes.
//!
//! C may copy them, and a fault of the application may overwrite them. So the struct contains no Rust
//! value but an encoding of it with a checksum: a value is made only of bytes that this library wrote.

use std::mem::offset_of;
use std::slice;

use ecan_c_boundary::result::ecan_result_t::{self, ECAN_ERR_FULL, ECAN_ERR_NOT_INITIALISED};
use ecan_c_boundary::{Call, OutPointer};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// An opaque struct of C with the encoding of a value.
pub(crate) trait Encoded: Sized {
    type Value: Serialize + DeserializeOwned;
    /// Marks an initialised struct.
    const SEAL: u64;
    /// The function that initialises it.
    const INIT: &'static str;
}

/// Start of the struct. The encoding follows; the rest is zero.
#[repr(C)]
struct Header {
    seal: u64,
    length: u64,
    /// Of length and encoding.
    checksum: u64,
}

const ZERO: [u8; 256] = [0; 256];

const CHECKSUM: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);

impl Header {
    fn new(seal: u64, encoding: &[u8]) -> Self {
        let length = encoding.len() as u64;
        let mut digest = CHECKSUM.digest();
        digest.update(&length.to_ne_bytes());
        digest.update(encoding);
        Self { seal, length, checksum: digest.finalize() }
    }
}

/// Bytes for the encoding in a struct of C.
const fn capacity<S: Encoded>() -> usize {
    const { assert!(align_of::<S>() >= align_of::<Header>()) };
    size_of::<S>() - size_of::<Header>()
}

/// Decodes the value in a struct of C.
///
/// # Safety
/// `storage` is NULL or valid for reading, with any content.
unsafe fn read<S: Encoded>(
    call: Call,
    name: &str,
    storage: *const S,
) -> Result<Box<S::Value>, ecan_result_t> {
    // SAFETY: the caller's promise.
    unsafe { call.read(name, storage)? };
    // SAFETY: the struct starts with a header, and any bytes are good for its integers.
    let header = unsafe { storage.cast::<Header>().read() };
    if header.seal != S::SEAL {
        let text = format_args!("`{name}` is not initialised: call {} first", S::INIT);
        return Err(call.fail(ECAN_ERR_NOT_INITIALISED, text));
    }
    let length = usize::try_from(header.length).unwrap_or(usize::MAX);
    if length > capacity::<S>() {
        return Err(corrupted::<S>(call, name));
    }
    // SAFETY: within the struct.
    let encoding =
        unsafe { slice::from_raw_parts(storage.cast::<u8>().add(size_of::<Header>()), length) };
    // SAFETY: the rest of the struct.
    let rest = unsafe {
        let end = storage.cast::<u8>().add(size_of::<Header>() + length);
        slice::from_raw_parts(end, capacity::<S>() - length)
    };
    let rest_is_zero = rest.chunks(ZERO.len()).all(|part| *part == ZERO[..part.len()]);
    if Header::new(S::SEAL, encoding).checksum != header.checksum || !rest_is_zero {
        return Err(corrupted::<S>(call, name));
    }
    match postcard::take_from_bytes::<Box<S::Value>>(encoding) {
        Ok((value, [])) => Ok(value),
        _ => Err(corrupted::<S>(call, name)),
    }
}

#[cold]
fn corrupted<S: Encoded>(call: Call, name: &str) -> ecan_result_t {
    let text = format_args!(
        "`{name}` was overwritten after its initialisation: its bytes are not those that the library \
         wrote; look for a write out of bounds, and call {} again",
        S::INIT
    );
    call.fail(ECAN_ERR_NOT_INITIALISED, text)
}

/// Encodes a value into a struct of C. After an error its content is that of before.
///
/// # Safety
/// `storage` is valid for writing.
unsafe fn write<S: Encoded>(
    call: Call,
    storage: *mut S,
    value: &S::Value,
) -> Result<(), ecan_result_t> {
    let mut buffer = vec![0; capacity::<S>()];
    let encoding = postcard::to_slice(value, &mut buffer).map_err(|error| {
        let most = capacity::<S>();
        let text = format_args!("the configuration does not fit into {most} bytes: {error}");
        call.fail(ECAN_ERR_FULL, text)
    })?;
    let header = Header::new(S::SEAL, encoding);
    // SAFETY: header and buffer have the size of the struct together; C's memory is not the buffer.
    unsafe {
        storage.cast::<Header>().write(header);
        let content = storage.cast::<u8>().add(size_of::<Header>());
        content.copy_from_nonoverlapping(buffer.as_ptr(), buffer.len());
    }
    Ok(())
}

/// A configuration that is changed.
pub(crate) struct EncodedMut<S: Encoded> {
    storage: *mut S,
    pub(crate) value: Box<S::Value>,
}

impl<S: Encoded> EncodedMut<S> {
    /// Stores the changed value.
    pub(crate) fn store(self, call: Call) -> Result<(), ecan_result_t> {
        // SAFETY: `encoded_mut` was promised that it is valid for writing.
        unsafe { write(call, self.storage, &self.value) }
    }
}

/// Access to configurations of C, for `pointers!`.
pub(crate) trait EncodedCall {
    /// Decodes a configuration.
    ///
    /// # Safety
    /// `storage` is NULL or valid for reading, and not written to during the call.
    unsafe fn encoded<S: Encoded>(
        self,
        name: &str,
        storage: *const S,
    ) -> Result<Box<S::Value>, ecan_result_t>;

    /// Decodes a configuration to change it.
    ///
    /// # Safety
    /// `storage` is NULL or valid for reading and writing as long as the result lives, and not used
    /// otherwise.
    unsafe fn encoded_mut<S: Encoded>(
        self,
        name: &str,
        storage: *mut S,
    ) -> Result<EncodedMut<S>, ecan_result_t>;

    /// Stores a new configuration.
    fn encode<S: Encoded>(
        self,
        storage: &OutPointer<S>,
        value: &S::Value,
    ) -> Result<(), ecan_result_t>;
}

impl EncodedCall for Call {
    unsafe fn encoded<S: Encoded>(
        self,
        name: &str,
        storage: *const S,
    ) -> Result<Box<S::Value>, ecan_result_t> {
        // SAFETY: the caller's promise.
        unsafe { read(self, name, storage) }
    }

    unsafe fn encoded_mut<S: Encoded>(
        self,
        name: &str,
        storage: *mut S,
    ) -> Result<EncodedMut<S>, ecan_result_t> {
        // SAFETY: the caller's promise.
        Ok(EncodedMut { storage, value: unsafe { read(self, name, storage)? } })
    }

    fn encode<S: Encoded>(
        self,
        storage: &OutPointer<S>,
        value: &S::Value,
    ) -> Result<(), ecan_result_t> {
        // SAFETY: `Call::out` was promised that the pointer is valid for writing.
        unsafe { write(self, storage.as_ptr(), value) }
    }
}

const _: () = assert!(offset_of!(Header, checksum) + 8 == size_of::<Header>());

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use ecan_host::{
        ClockSource, DcSync, Identity, MAX_SLAVES, SlaveConfig, StartupEntry, StartupStep,
    };
    use ecan_mcan_port::{
        ChannelConfig, ChannelFilter, GatewayConfig, MAX_FILTERS, MAX_GATEWAYS, MarginCheck,
        MeasuredOn, PortConfig, ScheduleConfig, Traffic,
    };
    use ecan_protocol::config::{ConfigObject, ExtendedFilter, List};
    use ecan_protocol::sequence::Expectation;

    use super::*;
    use crate::adapter::config::{IghConfig, ecan_igh_config_t};
    use crate::mcan_port::config::igh_mcan_port_config_t;

    /// Sets every field to the largest value that it takes.
    fn fill(object: &mut impl ConfigObject) {
        for subindex in 0..=u8::MAX {
            let largest = (0..32).map(|bits| u32::MAX >> bits).chain([0]);
            for value in largest {
                if object.set_value(subindex, value).is_ok() {
                    break;
                }
            }
        }
    }

    fn largest_port() -> PortConfig {
        let mut channel = ChannelConfig::fd(u32::MAX, u32::MAX);
        fill(&mut channel.can);
        fill(&mut channel.data_path);
        channel.traffic = Traffic { received: u8::MAX, sent: u8::MAX };
        let gateway = GatewayConfig {
            tx_channel_mask: Some(u8::MAX),
            rx_channel_mask: Some(u8::MAX),
            hold_limit: u16::MAX,
            input_limit: u16::MAX,
            schedule: ScheduleConfig {
                latest_send_ns: u32::MAX,
                transport_ns: u32::MAX,
                processing_ns: u32::MAX,
                margin_check: MarginCheck::Reject,
                watch_ms: u32::MAX,
                depth: u16::MAX,
                ..ScheduleConfig::default()
            },
            measured_on: Some(MeasuredOn {
                serial: Some(u64::MAX),
                firmware: Some((u32::MAX, u32::MAX)),
            }),
            ..GatewayConfig::on_all_channels(channel)
        };
        let filter = ExtendedFilter { id1: u32::MAX, id2: u32::MAX, ..Default::default() };
        let filter = ChannelFilter { slave: usize::MAX, channel: u8::MAX, filter: filter.into() };
        PortConfig {
            filters: List::collect([filter; MAX_FILTERS]).unwrap(),
            ..PortConfig::uniform(MAX_GATEWAYS, gateway)
        }
    }

    fn largest_adapter() -> IghConfig {
        let mut config = IghConfig::largest();
        let slave = SlaveConfig {
            alias: u16::MAX,
            position: u16::MAX,
            rx_multiplier: u8::MAX,
            tx_multiplier: u8::MAX,
            identity: Some(Identity { vendor_id: u32::MAX, product_code: u32::MAX }),
        };
        let expected = Expectation::Masked { value: u64::MAX, mask: u64::MAX };
        let step = StartupStep::Expect { index: u16::MAX, subindex: u8::MAX, expected };
        let startup = StartupEntry { slave: usize::MAX, step };
        config.adapter.slaves = List::collect([slave; MAX_SLAVES]).unwrap();
        config.adapter.startup = List::collect([startup; ecan_host::MAX_STARTUP_STEPS]).unwrap();
        config.adapter.dc = Some(DcSync {
            source: ClockSource::Reference,
            reference: Some(usize::MAX),
            monitor_every: u32::MAX,
            ..DcSync::new(Duration::MAX, Duration::MAX)
        });
        config.port = Some(largest_port());
        config
    }

    fn length(value: &impl Serialize) -> usize {
        postcard::to_slice(value, &mut vec![0; 1 << 20]).unwrap().len()
    }

    #[test]
    fn largest_configurations_fit() {
        let port = length(&largest_port());
        let most = capacity::<igh_mcan_port_config_t>();
        assert!((10_000..most).contains(&port), "{port} of {most}");
        let adapter = length(&largest_adapter());
        let most = capacity::<ecan_igh_config_t>();
        assert!((port..most).contains(&adapter), "{adapter} of {most}");
    }
}
