"""Sends frames through a bridge with python-can and expects each back from the echo node."""

import sys

import can

# Seconds; an echo takes milliseconds.
PATIENCE = 60


def frame(identifier, data=b"", **how):
    how.setdefault("is_extended_id", identifier > 0x7FF)
    return can.Message(arbitration_id=identifier, data=data, **how)


CLASSIC = [frame(0x123, b"\x01\x02"), frame(0x12345678, bytes(range(8))), frame(0x7FF)]
REMOTE = [frame(0x124, is_remote_frame=True, dlc=3)]
FD = [
    frame(0x125, bytes(range(64)), is_fd=True, bitrate_switch=True),
    frame(0x126, bytes(12), is_fd=True),
]


def open_bus(kind, place):
    if kind == "socketcand":
        host, port = place.rsplit(":", 1)
        return can.Bus(interface=kind, host=host, port=int(port), channel="can0"), CLASSIC
    if kind == "terminal":
        bus = can.Bus(interface="slcan", channel=place, bitrate=500_000, sleep_after_open=0)
        return bus, CLASSIC + REMOTE
    timing = can.BitTimingFd.from_sample_point(
        f_clock=80_000_000,
        nom_bitrate=500_000,
        nom_sample_point=80.0,
        data_bitrate=2_000_000,
        data_sample_point=80.0,
    )
    channel = "socket://" + place
    bus = can.Bus(interface="slcan", channel=channel, timing=timing, sleep_after_open=0)
    return bus, CLASSIC + REMOTE + FD


def main():
    bus, frames = open_bus(*sys.argv[1:3])
    for sent in frames:
        bus.send(sent)
        echo = bus.recv(PATIENCE)
        if echo is None or not echo.equals(
            sent, timestamp_delta=None, check_channel=False, check_direction=False
        ):
            sys.exit(f"{sent} came back as {echo}")
    bus.shutdown()
    print(len(frames))


main()
