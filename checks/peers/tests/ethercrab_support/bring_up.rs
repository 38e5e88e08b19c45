//! SDOs of a master in PREOP to start a gateway (manual 5.4.3), for classic CAN on CAN0.

use std::ops::Deref;

use ethercrab::error::Error;
use ethercrab::{SubDevice, SubDeviceRef};

/// Value of an entry, with its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Value {
    U8(u8),
    U16(u16),
    U32(u32),
}
use Value::{U8, U16, U32};

type Step = (u16, u8, Value);

/// Channels 0 to 3.
pub const CHANNEL_MASK: u8 = 0x0F;
const BITRATE: u32 = 1_000_000;

/// Phase A: capabilities of the device.
const CAPABILITIES: [Step; 7] = [
    (0xF000, 2, U8(4)),
    (0xF000, 10, U8(1)),
    (0xF000, 11, U8(24)),
    (0xF000, 12, U16(0)),
    (0xF000, 15, U8(0)),
    (0xF000, 17, U16(128)),
    (0xF000, 18, U16(24)),
];

/// Phase E for classic CAN at 1 Mbit/s.
const CHANNEL: [Step; 17] = [
    (0x8001, 7, U8(0)),
    (0x8001, 8, U8(0)),
    (0x8001, 9, U8(0)),
    (0x8001, 15, U8(0)),
    (0x8001, 19, U32(BITRATE)),
    (0x8001, 21, U16(875)),
    (0x8001, 22, U16(875)),
    (0x8001, 36, U8(0)),
    (0x8001, 37, U8(0)),
    (0x8001, 38, U8(0)),
    (0x8001, 39, U8(0)),
    (0x8001, 65, U8(0)),
    (0x8001, 66, U8(0)),
    (0x8001, 68, U8(0)),
    (0x8001, 72, U8(0)),
    (0x8001, 73, U8(32)),
    (0x8001, 1, U8(1)),
];

/// Phases A to E for N = `chunks`, with each readback checked.
pub async fn configure<S>(gateway: &SubDeviceRef<'_, S>, chunks: u8) -> Result<(), Error>
where
    S: Deref<Target = SubDevice>,
{
    // A: masks may be larger than needed
    for (index, subindex, expected) in CAPABILITIES {
        let value = read(gateway, index, subindex, expected).await?;
        if ![12, 15].contains(&subindex) {
            assert_eq!(value, expected, "{index:#06x}:{subindex}");
        }
    }
    // B
    for (assignment, first) in [(0x1C12, 0x1600), (0x1C13, 0x1A00)] {
        write(gateway, (assignment, 0, U8(0))).await?;
        for chunk in 0..chunks {
            write(gateway, (assignment, chunk + 1, U16(first + u16::from(chunk)))).await?;
        }
        write(gateway, (assignment, 0, U8(chunks))).await?;
    }
    // C
    for profile in [0x8010, 0x8011] {
        let values = [(3, chunks), (4, CHANNEL_MASK), (5, 0), (6, 0), (7, 0), (1, 1)];
        for (subindex, value) in values {
            write(gateway, (profile, subindex, U8(value))).await?;
        }
    }
    // D
    let bytes = 128 * u16::from(chunks);
    let word = u32::from(chunks - 1) | u32::from(CHANNEL_MASK) << 5;
    for profile in [0x8010, 0x8011] {
        expect(gateway, (profile, 2, U8(0))).await?;
        expect(gateway, (profile, 9, U16(bytes))).await?;
        expect(gateway, (profile, 10, U16(bytes - 24))).await?;
        expect(gateway, (profile, 12, U32(word))).await?;
    }
    // E
    for step in CHANNEL {
        write(gateway, step).await?;
    }
    expect(gateway, (0x8001, 2, U8(0))).await
}

async fn write<S>(
    gateway: &SubDeviceRef<'_, S>,
    (index, subindex, value): Step,
) -> Result<(), Error>
where
    S: Deref<Target = SubDevice>,
{
    match value {
        U8(value) => gateway.sdo_write(index, subindex, value).await,
        U16(value) => gateway.sdo_write(index, subindex, value).await,
        U32(value) => gateway.sdo_write(index, subindex, value).await,
    }
}

async fn read<S>(
    gateway: &SubDeviceRef<'_, S>,
    index: u16,
    subindex: u8,
    size: Value,
) -> Result<Value, Error>
where
    S: Deref<Target = SubDevice>,
{
    Ok(match size {
        U8(_) => U8(gateway.sdo_read(index, subindex).await?),
        U16(_) => U16(gateway.sdo_read(index, subindex).await?),
        U32(_) => U32(gateway.sdo_read(index, subindex).await?),
    })
}

async fn expect<S>(
    gateway: &SubDeviceRef<'_, S>,
    (index, subindex, value): Step,
) -> Result<(), Error>
where
    S: Deref<Target = SubDevice>,
{
    let found = read(gateway, index, subindex, value).await?;
    assert_eq!(found, value, "{index:#06x}:{subindex}");
    Ok(())
}
