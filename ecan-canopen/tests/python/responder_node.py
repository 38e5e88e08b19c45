"""A node of the package `durand`: an LSS slave without node-ID, with a bit rate and a storage, and an SDO
server with block transfer in both directions. Writes every LSS request that it receives, with the number of
frames that it has sent until then, and TIME messages."""

import sys

from durand import CANBusNetwork, DatatypeEnum, MinimalNode, Variable

import peer

IDENTITY = [0x4455_5241, 0x0000_0005, 0x8000_0001]


class CountingNetwork(CANBusNetwork):
    sent = 0

    def send(self, cob_id, msg):
        super().send(cob_id, msg)
        self.sent += 1


def main():
    arguments = peer.arguments("port", "serial")
    bus = peer.slcan(arguments.port)
    network = CountingNetwork(bus)
    node = MinimalNode(network, 0xFF)
    for subindex, value in enumerate([*IDENTITY, arguments.serial], 1):
        node.object_dictionary.write(0x1018, subindex, value)
    node.object_dictionary[0x2000] = Variable(DatatypeEnum.DOMAIN, "rw", b"", name="Domain")
    node.object_dictionary[0x2001] = Variable(DatatypeEnum.DOMAIN, "ro", bytes(range(1, 200)), name="Text")
    node.lss.set_baudrate_change_callback(lambda bit_rate, delay: peer.tell(f"bit rate {bit_rate}"))
    node.lss.set_store_configuration_callback(lambda bit_rate, node_id: peer.tell(f"store {bit_rate} {node_id}"))

    handle = node.lss.handle_msg

    def log_and_handle(cob_id, data):
        handle(cob_id, data)
        # The response, if any, is sent.
        peer.tell(f"lss {bytes(data).hex()} {network.sent}")

    downloads = node.sdo_servers[0].download_manager
    begin_block = downloads.download_block_init

    def log_and_begin_block(data):
        begin_block(data)
        peer.tell("block download")

    downloads.download_block_init = log_and_begin_block
    network.add_subscription(0x7E5, log_and_handle)
    network.add_subscription(0x100, lambda _id, data: peer.tell(f"time {bytes(data).hex()}"))
    peer.tell("ready")
    sys.stdin.read()
    network.stop()
    bus.shutdown()


main()
