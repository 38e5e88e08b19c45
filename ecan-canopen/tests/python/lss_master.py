"""The LSS master of the package `canopen` in front of a simulated drive without node-ID: fastscan,
inquiries, node-ID, bit rate, store. Then the package's node guarding and TIME."""

import time

import can
import canopen
from canopen.lss import LssError

import peer

DEADLINE = 60
IDENTITY = [0x5349_4D00, 402, 0x0001_0000, 77]


def configure(lss, node):
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    peer.expect("node-ID before", lss.inquire_node_id(), 0xFF)
    lss.send_switch_state_global(lss.WAITING_STATE)

    found, identity = lss.fast_scan()
    peer.expect("fastscan", (found, identity), (True, IDENTITY))
    # The scan has selected the drive.
    peer.expect("node-ID", lss.inquire_node_id(), 0xFF)
    for command, value in zip([0x5A, 0x5B, 0x5C, 0x5D], IDENTITY):
        peer.expect(f"identity {command:X}", lss.inquire_lss_address(command), value)
    lss.send_switch_state_global(lss.WAITING_STATE)

    peer.expect("selective switch", lss.send_switch_state_selective(*IDENTITY), True)
    try:
        lss.configure_node_id(128)
        raise SystemExit("node-ID 128 was accepted")
    except LssError as error:
        peer.expect("error", str(error), "LSS Error: 1")
    lss.configure_node_id(node)
    lss.configure_bit_timing(2)
    lss.store_configuration()
    lss.send_switch_state_global(lss.WAITING_STATE)


def guard(network, node):
    """The package sends remote frames; the responses are read here."""
    responses = []
    network.subscribe(0x700 + node, lambda _id, data, _time: responses.append(data[0]))
    master = canopen.RemoteNode(node, canopen.ObjectDictionary())
    network.add_node(master)
    master.nmt.start_node_guarding(0.05)
    end = time.monotonic() + DEADLINE
    while len(responses) < 6:
        if time.monotonic() > end:
            raise SystemExit(f"guarding: {responses}")
        time.sleep(0.01)
    master.nmt.stop_node_guarding()
    # Pre-operational, with a toggle bit that begins with 0.
    peer.expect("guarding", responses[:6], [0x7F, 0xFF] * 3)
    peer.expect("state", master.nmt.state, "PRE-OPERATIONAL")


def main():
    arguments = peer.arguments("port", "node")
    with peer.network(arguments.port) as network:
        booted = []
        network.subscribe(
            0x700 + arguments.node, lambda _id, data, _time: booted.append(bytes(data))
        )
        network.lss.RESPONSE_TIMEOUT = 0.5
        configure(network.lss, arguments.node)
        end = time.monotonic() + DEADLINE
        while booted != [b"\0"]:
            if time.monotonic() > end:
                raise SystemExit(f"boot-up: {booted}")
            time.sleep(0.01)
        network.unsubscribe(0x700 + arguments.node)
        guard(network, arguments.node)
        # 0x1012: the drive consumes TIME.
        request = bytes([0x23, 0x12, 0x10, 0, 0x00, 0x01, 0x00, 0x80])
        network.send_message(0x600 + arguments.node, request)
        time.sleep(0.2)
        # 2026-11-24T13:45:00.250Z
        network.time.transmit(1_795_527_900.25)
        peer.ask("time")
    peer.tell("passed")


main()
