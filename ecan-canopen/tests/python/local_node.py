"""A CANopen node made by the package `canopen`: an SDO server with a small object dictionary,
boot-up, heartbeat, NMT and EMCY."""

import struct
import sys

import canopen
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

import peer

# A write of an error code to this object makes the node send it as an emergency.
EMERGENCY = 0x2010


def variable(name, index, subindex, kind, access="rw", value=None):
    entry = ODVariable(name, index, subindex)
    entry.data_type = kind
    entry.access_type = access
    entry.value = value
    return entry


def object_dictionary():
    objects = canopen.ObjectDictionary()
    u8, u16, u32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
    for entry in [
        variable("Device type", 0x1000, 0, u32, "ro", 0x0002_0192),
        variable("Error register", 0x1001, 0, u8, "ro", 0),
        variable(
            "Device name", 0x1008, 0, datatypes.VISIBLE_STRING, "const", "A node made in Python"
        ),
        variable("Producer heartbeat time", 0x1017, 0, u16, "rw", 0),
        variable("Number", 0x2000, 0, u32, "rw", 0),
        variable("Signed", 0x2001, 0, datatypes.INTEGER16, "rw", -2),
        variable("Domain", 0x2002, 0, datatypes.DOMAIN, "rw"),
        variable("Write only", 0x2003, 0, u8, "wo"),
        variable("Emergency", EMERGENCY, 0, u16, "rw", 0),
    ]:
        objects.add_object(entry)
    identity = ODRecord("Identity", 0x1018)
    for subindex, (name, value) in enumerate(
        [("Entries", 4), ("Vendor", 0x50595448), ("Product", 3), ("Revision", 7), ("Serial", 99)]
    ):
        kind = u8 if subindex == 0 else u32
        identity.add_member(variable(name, 0x1018, subindex, kind, "ro", value))
    objects.add_object(identity)
    return objects


def main():
    arguments = peer.arguments("port", "node")
    with peer.network(arguments.port) as network:
        node = network.add_node(canopen.LocalNode(arguments.node, object_dictionary()))

        def emergency(index, data, **_):
            if index == EMERGENCY:
                (code,) = struct.unpack("<H", data)
                node.emcy.send(code, 0x20 if code else 0, b"\x01\x02\x03\x04\x05")

        node.add_write_callback(emergency)
        node.nmt.state = "INITIALISING"
        node.nmt.state = "PRE-OPERATIONAL"
        sys.stdin.read()


main()
