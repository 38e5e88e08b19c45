"""The package `canopen` configures a node from a DCF, and reads the configuration back."""

import argparse

from canopen.objectdictionary import ODVariable

import peer

parser = argparse.ArgumentParser()
parser.add_argument("--port", type=int, required=True)
parser.add_argument("--node", type=int, required=True)
parser.add_argument("--dcf", required=True)
arguments = parser.parse_args()


def variables(dictionary):
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            yield from (entry[subindex] for subindex in sorted(entry.subindices))


with peer.network(arguments.port) as network:
    node = network.add_node(arguments.node, arguments.dcf)
    node.sdo.RESPONSE_TIMEOUT = 20
    peer.expect("device type", node.sdo["Device type"].raw & 0xFFFF, 402)
    node.load_configuration()
    compared = 0
    for variable in variables(node.object_dictionary):
        if variable.index < 0x1000 or variable.value is None:
            continue
        is_single = isinstance(node.object_dictionary[variable.index], ODVariable)
        entry = node.sdo[variable.index]
        found = (entry if is_single else entry[variable.subindex]).raw
        peer.expect(f"{variable.index:04X}:{variable.subindex}", found, variable.value)
        compared += 1
    peer.tell(f"compared {compared}")
