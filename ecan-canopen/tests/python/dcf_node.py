"""A node made by the package `canopen` from an EDS. It prints every SDO frame of the node, `frame ID#DATA`.

For a line with the name of a DCF on the standard input, it loads the file with the tools of the package,
and prints each value with the bytes of the file and those of the node, `value OBJECT FILE NODE`, then `end`.
"""

import argparse
import sys

import canopen
from canopen.objectdictionary import ODVariable

import peer


def variables(dictionary):
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            yield from entry.subindices.values()


def compare(node, path):
    for entry in variables(canopen.import_od(path, node.id)):
        if entry.index < 0x1000 or entry.value is None:
            continue
        of_file = entry.encode_raw(entry.value).hex().upper()
        of_node = node.get_data(entry.index, entry.subindex).hex().upper()
        peer.tell(f"value {entry.index:04X}:{entry.subindex:02X} {of_file} {of_node}")
    peer.tell("end")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--node", type=int, required=True)
    parser.add_argument("--eds", required=True)
    arguments = parser.parse_args()
    with peer.network(arguments.port) as network:

        def log(can_id, data, *_):
            peer.tell(f"frame {can_id:03X}#{bytes(data).hex().upper()}")

        # Before the node answers.
        network.subscribe(0x600 + arguments.node, log)
        send = network.send_message

        def logged(can_id, data, remote=False):
            if can_id == 0x580 + arguments.node:
                log(can_id, data)
            send(can_id, data, remote)

        network.send_message = logged
        node = network.add_node(canopen.LocalNode(arguments.node, arguments.eds))
        node.nmt.state = "INITIALISING"
        node.nmt.state = "PRE-OPERATIONAL"
        for line in sys.stdin:
            compare(node, line.strip())


main()
