"""python-can's two interfaces on one CAN FD bus: what one sends the other receives."""

import random

import can

import peer


def messages(chance, fd):
    """Frames of every format."""
    for number in range(200):
        extended = chance.random() < 0.5
        identifier = chance.randrange(1 << (29 if extended else 11))
        common = {"arbitration_id": identifier, "is_extended_id": extended}
        kind = number % 4
        if fd and kind == 0:
            yield can.Message(is_remote_frame=True, dlc=chance.randrange(9), **common)
        elif fd and kind in (1, 2):
            length = chance.choice([0, 1, 7, 8, 12, 16, 20, 24, 32, 48, 64])
            data = chance.randbytes(length)
            yield can.Message(is_fd=True, bitrate_switch=kind == 2, data=data, **common)
        else:
            yield can.Message(data=chance.randbytes(chance.randrange(9)), **common)


def is_same(sent, received):
    return received is not None and received.equals(
        sent, timestamp_delta=None, check_channel=False, check_direction=False
    )


def carry(sender, receiver, sent):
    """Sends everything and compares it with what comes."""
    for message in sent:
        sender.send(message)
        received = receiver.recv(60)
        if not is_same(message, received):
            raise SystemExit(f"sent {message}, received {received}")


def catch_up(sender, receiver):
    """Throws away what the receiver has heard meanwhile."""
    marker = can.Message(arbitration_id=0x7FF, data=b"marker", is_extended_id=False)
    sender.send(marker)
    while not is_same(marker, received := receiver.recv(60)):
        if received is None:
            raise SystemExit("the marker does not come")


def main():
    arguments = peer.arguments("slcan", "other", "daemon")
    chance = random.Random(1)
    one = peer.slcan(arguments.slcan)
    two = peer.slcan(arguments.other)
    daemon = can.Bus(
        interface="socketcand", host="127.0.0.1", port=arguments.daemon, channel="can0"
    )
    with one, two, daemon:
        peer.expect("version", one.get_version(60), (10, 10))
        peer.expect("serial number", one.get_serial_number(60), "ECAN")
        # Only now both channels are known to be open.
        peer.expect("version", two.get_version(60), (10, 10))
        carry(one, two, messages(chance, True))
        carry(two, one, messages(chance, True))
        catch_up(one, daemon)
        carry(one, daemon, messages(chance, False))
        carry(daemon, one, messages(chance, False))
    peer.tell("passed")


main()
