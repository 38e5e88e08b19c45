"""Decodes random frames of each message with cantools, encodes the values again, and prints both.

decode.py FILE

A line is: CAN ID in hex, E or S, data in hex, data encoded of the decoded values, name=value ...
"""

import math
import random
import sys

import cantools

database = cantools.database.load_file(sys.argv[1])
random.seed(11)
for message in database.messages:
    if message.name == "VECTOR__INDEPENDENT_SIG_MSG":
        continue
    count = 0
    while count < 50:
        data = random.randbytes(message.length)
        try:
            values = message.decode(data, decode_choices=False)
        except cantools.database.errors.DecodeError:
            # cantools rejects a multiplexer value without signals.
            continue
        if not all(math.isfinite(value) for value in values.values()):
            continue
        count += 1
        encoded = message.encode(values, strict=False)
        texts = " ".join(f"{name}={value!r}" for name, value in values.items())
        form = "E" if message.is_extended_frame else "S"
        print(f"{message.frame_id:X} {form} {data.hex()} {encoded.hex()} {texts}")
