"""Process data images byte by byte, as in manual 5.4.4.1 and 8."""

import struct

HEADER = 24
CHANNEL_MASK = 0x0F
# Data bytes by DLC.
LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
FDF, BRS = 1 << 8, 1 << 9


def crc16(data):
    """CRC-16/CCITT-FALSE."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def write(size, sequence, frames):
    """An RxPDO image with frames for CAN0: pairs of CAN ID and data; more than 8 bytes are CAN FD."""
    payload = b""
    for can_id, data in frames:
        flags = FDF | BRS if len(data) > 8 else 0
        payload += struct.pack("<HH", LENGTHS.index(len(data)) << 3 | flags, can_id) + data
    layout = size // 128 - 1 | CHANNEL_MASK << 5
    crc = crc16(payload)
    head = struct.pack("<BBHHHHHBBBB", 0x16, 0, sequence, sequence, len(payload), crc, layout,
                       CHANNEL_MASK, len(frames), 0, 1)
    image = head.ljust(HEADER, b"\0") + payload
    assert len(image) <= size
    return image.ljust(size, b"\0")


def read(image):
    """Sequence and frames of a TxPDO image; None before the first one."""
    if image[0] == 0:
        return None
    magic, _, sequence, end, length, crc = struct.unpack_from("<BBHHHH", image)
    assert (magic, image[14], image[15], sequence) == (0x16, 0, 1, end), image[:HEADER].hex()
    payload = image[HEADER:HEADER + length]
    assert crc16(payload) == crc
    frames = []
    at = 0
    while at < length:
        control, can_id = struct.unpack_from("<HH", payload, at)
        size = LENGTHS[control >> 3 & 0x0F]
        assert control & ~0x78 == (FDF | BRS if size > 8 else 0), hex(control)
        frames.append((can_id & 0x7FF, bytes(payload[at + 4:at + 4 + size])))
        at += 4 + size
    assert len(frames) == image[13]
    return sequence, frames


def check_example():
    """The example of the manual: N = 8, channel mask 0x0F, sequence 1."""
    image = write(1024, 1, [(0x123, bytes.fromhex("1122334455667788"))])
    assert image[:16].hex() == "1600010001000c00d356e7010f010001", image[:16].hex()
    assert image[24:36].hex() == "400023011122334455667788"


check_example()
