"""Writes frames with python-can in several formats, and prints them as lines of a candump log.

write_recordings.py DIRECTORY
"""

import random
import sys
from pathlib import Path

import can

directory = Path(sys.argv[1])
random.seed(7)


def message(nth, kinds):
    kind = kinds[nth % len(kinds)]
    is_extended = random.random() < 0.5
    is_fd = kind == "fd"
    length = random.choice([0, 1, 8, 12, 64]) if is_fd else random.randint(0, 8)
    # python-can's reader of ASC takes a CAN FD frame without data for a remote one.
    length = max(length, 1) if is_fd else length
    remote = kind == "remote"
    return can.Message(
        timestamp=1000.0 + nth * 0.0125,
        arbitration_id=random.randint(0x800, 0x1FFFFFFF) if is_extended else random.randint(0, 0x7FF),
        is_extended_id=is_extended,
        is_fd=is_fd,
        bitrate_switch=is_fd and random.random() < 0.5,
        error_state_indicator=is_fd and random.random() < 0.5,
        is_remote_frame=remote,
        dlc=length,
        data=b"" if remote else random.randbytes(length),
        channel=nth % 2,
        is_error_frame=kind == "error",
    )


def text(message, has_remote_length):
    """The frame as in a candump log."""
    digits = 8 if message.is_extended_id else 3
    name = f"{message.arbitration_id:0{digits}X}#"
    if message.is_remote_frame:
        return name + "R" + (str(message.dlc) if message.dlc and has_remote_length else "")
    if message.is_fd:
        name += f"#{message.bitrate_switch + 2 * message.error_state_indicator}"
    return name + message.data.hex().upper()


def write(file, kinds, has_remote_length=True):
    messages = [message(nth, kinds) for nth in range(200)]
    writer = can.Logger(str(directory / file))
    for it in messages:
        writer(it)
    writer.stop()
    for it in messages:
        if not it.is_error_frame:
            print(file, it.channel, round((it.timestamp - 1000.0) * 1e6), text(it, has_remote_length))


write("all.asc", ["data", "fd", "remote", "error"])
write("all.blf", ["data", "fd", "remote", "error"])
# Its writer of candump logs omits the length of remote frames.
write("all.log", ["data", "fd", "remote", "error"], has_remote_length=False)
# Its writer of TRC has data frames only.
write("data.trc", ["data"])
