"""What all peers share: the way onto the simulated bus, and a few words with the test.

A peer writes a line to its standard output when it has got somewhere; the test writes a line to its
standard input when the peer may go on. The end of the input means that the test is over.
"""

import argparse
import contextlib
import logging
import sys

import can
import canopen

# The log goes where the test can show it, and does not mix with lines for the test.
logging.basicConfig(stream=sys.stderr, level=logging.ERROR)


def arguments(*names):
    """Port of the bridge, and node-ID or other numbers by name."""
    parser = argparse.ArgumentParser()
    for name in names:
        parser.add_argument(f"--{name}", type=int, required=True)
    return parser.parse_args()


def slcan(port, **settings):
    """A python-can bus on an slcan bridge."""
    settings.setdefault("bitrate", 500_000)
    channel = f"socket://127.0.0.1:{port}"
    return can.Bus(interface="slcan", channel=channel, sleep_after_open=0, **settings)


@contextlib.contextmanager
def network(port):
    """A CANopen network on an slcan bridge."""
    joined = canopen.Network(slcan(port))
    # How long the thread that receives may take to notice its end.
    joined.NOTIFIER_CYCLE = 0.05
    joined.connect()
    try:
        yield joined
    finally:
        joined.disconnect()


def tell(line):
    """A line for the test."""
    print(line, flush=True)


def ask(what):
    """Lets the test do something, and waits until it has."""
    tell(f"ask {what}")
    if not sys.stdin.readline():
        sys.exit("the test is over")


def expect(what, actual, expected):
    """Ends the script where something is not as it should be."""
    if actual != expected:
        sys.exit(f"{what}: {actual!r}, not {expected!r}")
