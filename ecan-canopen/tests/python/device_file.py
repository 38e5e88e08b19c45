"""Loads a device file with the package canopen and prints its values, one entry a line:
index, subindex, data type, access, default, value, separated by tabs. Bytes are hexadecimal digits;
`-` is no value. With --export it prints the DCF that the package writes instead."""

import argparse
import io
import sys

import canopen
from canopen.objectdictionary import ODVariable

parser = argparse.ArgumentParser()
parser.add_argument("--node", type=int, required=True)
parser.add_argument("--export", action="store_true")
arguments = parser.parse_args()

source = io.StringIO(sys.stdin.read())
source.name = "device.dcf"
dictionary = canopen.import_od(source, arguments.node)

if arguments.export:
    canopen.export_od(dictionary, sys.stdout, "dcf")
    sys.exit()


def text(value):
    if value is None:
        return "-"
    return value.hex() if isinstance(value, bytes) else str(value)


def show(variable):
    value = getattr(variable, "value", None)
    print(
        f"{variable.index:04X}",
        f"{variable.subindex:02X}",
        f"{variable.data_type:04X}",
        variable.access_type,
        text(variable.default),
        text(value),
        sep="\t",
    )


for entry in dictionary.values():
    # Dummy entries have the indices of data types.
    if entry.index < 0x1000:
        continue
    if isinstance(entry, ODVariable):
        show(entry)
    else:
        for subindex in sorted(entry.subindices):
            show(entry.subindices[subindex])
