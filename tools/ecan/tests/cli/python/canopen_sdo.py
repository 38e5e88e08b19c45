"""Reads and writes objects of the drives on CAN interfaces, all interfaces at once, with canopen."""

import sys
import threading

import canopen

NODES = range(1, 5)
ROUNDS = 25


def exchange(channel, results):
    network = canopen.Network()
    network.connect(interface="socketcan", channel=channel)
    try:
        for node_id in NODES:
            node = network.add_node(node_id, canopen.ObjectDictionary())
            node.sdo.RESPONSE_TIMEOUT = 5
            for period in range(100, 100 + ROUNDS):
                device = int.from_bytes(node.sdo.upload(0x1000, 0), "little")
                assert device & 0xFFFF == 402, hex(device)
                node.sdo.download(0x1017, 0, period.to_bytes(2, "little"))
                assert node.sdo.upload(0x1017, 0) == period.to_bytes(2, "little")
                results[channel] += 3
    finally:
        network.disconnect()


results = dict.fromkeys(sys.argv[1:], 0)
threads = [threading.Thread(target=exchange, args=(it, results)) for it in results]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
expected = 3 * ROUNDS * len(NODES)
assert all(count == expected for count in results.values()), results
print(f"canopen: {expected} SDO transfers on each of {len(results)} interfaces at once")
