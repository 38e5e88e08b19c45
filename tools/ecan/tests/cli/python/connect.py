"""Connects again and again to socketcand on a busy bus, as python-can does it."""

import sys

import can

PATIENCE = 60


def main():
    host, port = sys.argv[1].rsplit(":", 1)
    rounds = int(sys.argv[2])
    for _ in range(rounds):
        bus = can.Bus(interface="socketcand", host=host, port=int(port), channel="can0")
        if bus.recv(PATIENCE) is None:
            sys.exit("nothing is heard")
        bus.shutdown()
    print(rounds)


main()
