"""The CiA 402 master of the package `canopen` in front of the simulated drive: PDO mapping, power
state machine, homing, a move, a change of mode, quick stop, a fault and its reset, and SDO transfers
of every kind."""

import threading
import time

import canopen
from canopen.objectdictionary import ODRecord, ODVariable, datatypes
from canopen.profiles.p402 import BaseNode402

import peer

DEADLINE = 60

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32

OBJECTS = {
    0x1000: ("Device type", U32),
    0x1008: ("Device name", datatypes.VISIBLE_STRING),
    0x1017: ("Producer heartbeat time", U16),
    0x2000: ("Scratch", datatypes.DOMAIN),
    0x603F: ("Error code", U16),
    0x6040: ("Controlword", U16),
    0x6041: ("Statusword", U16),
    0x605A: ("Quick stop option code", I16),
    0x6060: ("Mode of operation", I8),
    0x6061: ("Mode of operation display", I8),
    0x6064: ("Position actual value", I32),
    0x606C: ("Velocity actual value", I32),
    0x607A: ("Target position", I32),
    0x6081: ("Profile velocity", U32),
    0x6098: ("Homing method", I8),
    0x60FF: ("Target velocity", I32),
    0x6502: ("Supported drive modes", U32),
}


def object_dictionary():
    objects = canopen.ObjectDictionary()
    for index, (name, kind) in OBJECTS.items():
        entry = ODVariable(name, index)
        entry.data_type = kind
        objects.add_object(entry)
    for number in range(4):
        for base, words in [(0x1400, "RPDO"), (0x1800, "TPDO")]:
            communication = ODRecord(f"{words} {number} communication", base + number)
            for subindex, kind in [(0, U8), (1, U32), (2, U8), (3, U16), (5, U16), (6, U8)]:
                entry = ODVariable(f"Entry {subindex}", base + number, subindex)
                entry.data_type = kind
                communication.add_member(entry)
            objects.add_object(communication)
            mapping = ODRecord(f"{words} {number} mapping", base + 0x200 + number)
            for subindex in range(9):
                entry = ODVariable(f"Entry {subindex}", base + 0x200 + number, subindex)
                entry.data_type = U32 if subindex else U8
                mapping.add_member(entry)
            objects.add_object(mapping)
    return objects


def until(what, done):
    """Waits; another program moves time meanwhile."""
    end = time.monotonic() + DEADLINE
    while not done():
        if time.monotonic() > end:
            raise SystemExit(f"{what} does not happen")
        time.sleep(0.01)


def boot(node):
    booted = threading.Event()
    node.nmt.add_heartbeat_callback(lambda state: booted.set() if state == 0 else None)
    node.nmt.send_command(0x81)
    if not booted.wait(DEADLINE):
        raise SystemExit("the drive does not boot")
    # canopen tells of the boot-up before it keeps the state.
    until("pre-operational", lambda: node.nmt.state == "PRE-OPERATIONAL")


def transfers(node):
    """Every kind of SDO transfer."""
    peer.expect("device type", node.sdo[0x1000].raw & 0xFFFF, 402)
    name = node.sdo[0x1008].raw
    peer.expect("length of the name", len(name) > 4, True)
    long = bytes(number * 11 & 0xFF for number in range(1000))
    for length in [0, 1, 4, 5, 7, 8, 888, 889, 890, 1000]:
        for block in [False, True]:
            if block and length == 0:
                continue
            value = long[:length]
            with node.sdo[0x2000].open(
                "wb", size=length, block_transfer=block, buffering=0
            ) as stream:
                rest = value
                while rest:
                    rest = rest[stream.write(rest) :]
            if length == 0:
                continue
            for read_by_block in [False, True]:
                with node.sdo[0x2000].open("rb", block_transfer=read_by_block) as stream:
                    peer.expect(f"{length} bytes", stream.read(), value)
    try:
        node.sdo.upload(0x2FFF, 0)
        raise SystemExit("an object that does not exist was read")
    except canopen.SdoAbortedError as error:
        peer.expect("abort code", error.code, 0x0602_0000)


def map_pdos(node):
    """Statusword, mode and position in; controlword and mode out."""
    node.tpdo.read()
    node.rpdo.read()
    received = node.tpdo[1]
    received.clear()
    for index in [0x6041, 0x6061, 0x6064]:
        received.add_variable(index)
    received.trans_type = 255
    received.event_timer = 20
    received.enabled = True
    received.save()
    sent = node.rpdo[1]
    sent.clear()
    for index in [0x6040, 0x6060]:
        sent.add_variable(index)
    sent.trans_type = 255
    sent.enabled = True
    sent.save()


def start(node):
    node.sdo[0x1017].raw = 50
    node.setup_402_state_machine()
    peer.expect("controlword is mapped", 0x6040 in node.rpdo_pointers, True)
    peer.expect("statusword is mapped", 0x6041 in node.tpdo_pointers, True)
    node.nmt.state = "OPERATIONAL"
    until("operational", lambda: node.nmt.wait_for_heartbeat(DEADLINE) == "OPERATIONAL")
    # The values of the state machine are 0 until the first TPDO.
    until("a TPDO", lambda: node.tpdo_values[0x6041] != 0)


def take_mode(node, mode):
    node.op_mode = mode
    until(f"mode {mode}", lambda: node.op_mode == mode)


def move(node, target):
    """A profile position move with the handshake of the new set-point."""
    node.sdo[0x607A].raw = target
    node.controlword = 0x0F
    until("the handshake is over", lambda: not node.statusword & 0x1000)
    node.controlword = 0x1F
    until("the set-point is taken", lambda: node.statusword & 0x1000)
    node.controlword = 0x0F
    until("the target is reached", lambda: node.statusword & 0x1400 == 0x0400)
    peer.expect("distance to the target", abs(node.sdo[0x6064].raw - target) <= 200, True)


def turn(node, velocity):
    """Profile velocity."""
    node.sdo[0x60FF].raw = velocity
    near = abs(velocity) // 10
    until("the velocity", lambda: abs(node.sdo[0x606C].raw - velocity) <= near)
    node.sdo[0x60FF].raw = 0
    until("standstill", lambda: node.sdo[0x606C].raw == 0)


def main():
    arguments = peer.arguments("port", "node")
    with peer.network(arguments.port) as network:
        node = BaseNode402(arguments.node, object_dictionary())
        network.add_node(node)
        node.sdo.RESPONSE_TIMEOUT = DEADLINE
        node.TIMEOUT_SWITCH_OP_MODE = DEADLINE
        node.TIMEOUT_SWITCH_STATE_FINAL = DEADLINE
        node.TIMEOUT_SWITCH_STATE_SINGLE = DEADLINE
        node.TIMEOUT_CHECK_TPDO = DEADLINE

        boot(node)
        transfers(node)
        map_pdos(node)
        start(node)

        take_mode(node, "PROFILED POSITION")
        node.state = "OPERATION ENABLED"
        peer.expect("state", node.state, "OPERATION ENABLED")
        move(node, 30_000)
        move(node, -30_000)

        node.sdo[0x6098].raw = 37
        peer.expect("homing", node.homing(timeout=DEADLINE), True)
        peer.expect("position after homing", abs(node.sdo[0x6064].raw) <= 200, True)

        node.sdo[0x60FF].raw = 0
        take_mode(node, "PROFILED VELOCITY")
        node.controlword = 0x0F
        turn(node, 20_000)

        # Quick stop in which the drive stays, and the way back.
        node.sdo[0x605A].raw = 6
        node.state = "QUICK STOP ACTIVE"
        node.state = "OPERATION ENABLED"

        peer.ask("fault")
        until("the fault", lambda: node.state == "FAULT")
        until("the emergency", lambda: node.emcy.active)
        peer.expect("emergency", node.emcy.active[-1].code, 0x2310)
        peer.expect("error code", node.sdo[0x603F].raw, 0x2310)
        node.reset_from_fault()
        peer.expect("state", node.state, "OPERATION ENABLED")
        until("the end of the emergency", lambda: not node.emcy.active)

        node.state = "SWITCH ON DISABLED"
        peer.expect("state", node.state, "SWITCH ON DISABLED")
        node.nmt.state = "PRE-OPERATIONAL"
    peer.tell("passed")


main()
