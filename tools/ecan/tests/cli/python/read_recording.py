"""Prints the frames of a recording as python-can reads them: time in microseconds, channel, and fields.

read_recording.py FILE
"""

import sys

import can

first = None
for message in can.LogReader(sys.argv[1]):
    first = message.timestamp if first is None else first
    print(
        round((message.timestamp - first) * 1e6),
        message.channel,
        f"{message.arbitration_id:X}",
        message.is_extended_id,
        message.is_remote_frame,
        message.is_fd,
        message.bitrate_switch,
        message.error_state_indicator,
        message.is_rx,
        message.dlc,
        message.data.hex(),
    )
