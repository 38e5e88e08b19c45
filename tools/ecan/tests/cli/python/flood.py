"""Sends frames as fast as the connection takes them, and is still heard afterwards."""

import sys

import can

PATIENCE = 60


def frame(number):
    data = number.to_bytes(4, "big")
    return can.Message(arbitration_id=0x123, data=data, is_extended_id=False)


def main():
    host, port = sys.argv[1].rsplit(":", 1)
    count = int(sys.argv[2])
    bus = can.Bus(interface="socketcand", host=host, port=int(port), channel="can0")
    for number in range(count):
        bus.send(frame(number))
    # The echo node may lose some of so many, but it keeps their order.
    heard = -1
    for last in range(count, count + PATIENCE):
        bus.send(frame(last))
        while heard < last:
            echo = bus.recv(1)
            if echo is None:
                break
            number = int.from_bytes(echo.data, "big")
            if echo.is_error_frame or number <= heard:
                sys.exit(f"behind {heard}: {echo}")
            heard = number
        if heard == last:
            bus.shutdown()
            print(count)
            return
    sys.exit(f"no echo behind {heard}")


main()
