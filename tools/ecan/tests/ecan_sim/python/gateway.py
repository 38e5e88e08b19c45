"""The sequence of manual 5.4.3 over a master's SDOs."""

import struct

import image

BITRATE, DATA_BITRATE = 1_000_000, 5_000_000
U8, U16, U32 = "<B", "<H", "<I"


def write(slave, index, subindex, kind, value):
    slave.sdo_write(index, subindex, struct.pack(kind, value))


def read(slave, index, subindex, kind):
    return struct.unpack(kind, slave.sdo_read(index, subindex))[0]


def expect(slave, index, subindex, kind, value):
    found = read(slave, index, subindex, kind)
    assert found == value, f"{index:#06x}:{subindex} is {found}, expected {value}"


def configure(slave, chunks, is_fd):
    """Brings a gateway in PREOP to a configuration with N = chunks and CAN0 enabled."""
    expect(slave, 0xF000, 17, U16, 128)
    expect(slave, 0xF000, 18, U16, image.HEADER)
    for assignment, first in ((0x1C12, 0x1600), (0x1C13, 0x1A00)):
        write(slave, assignment, 0, U8, 0)
        for chunk in range(chunks):
            write(slave, assignment, 1 + chunk, U16, first + chunk)
        write(slave, assignment, 0, U8, chunks)
    for profile in (0x8010, 0x8011):
        for subindex, value in ((3, chunks), (4, image.CHANNEL_MASK), (5, 0), (6, 0), (7, 0), (1, 1)):
            write(slave, profile, subindex, U8, value)
        expect(slave, profile, 2, U8, 0)
        expect(slave, profile, 9, U16, 128 * chunks)
    write(slave, 0x8001, 15, U8, 1 if is_fd else 0)
    write(slave, 0x8001, 19, U32, BITRATE)
    if is_fd:
        write(slave, 0x8001, 20, U32, DATA_BITRATE)
    write(slave, 0x8001, 1, U8, 1)
    expect(slave, 0x8001, 2, U8, 0)
