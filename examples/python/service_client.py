#!/usr/bin/env python3
"""Sends one CAN frame through a service (docs/SERVICE.md) and prints the frames of the bus.

service_client.py SOCKET [ID#DATA]        for example /run/ecan/master0.sock 123#1122
"""
import json, socket, struct, sys

KINDS = ["received", "transmitted", "failed", "lost", "published", "rejected", "unknown"]
service = socket.socket(socket.AF_UNIX)
service.connect(sys.argv[1])
stream = service.makefile("rb")


def write(kind, payload):
    try:
        service.sendall(struct.pack("<IB3x", len(payload), kind) + payload)
    except BrokenPipeError:
        pass  # the service has closed the connection; its last message states the reason


def read():
    header = stream.read(8) or sys.exit("the service closed the connection")
    length, kind = struct.unpack("<IB3x", header)
    return kind, stream.read(length)


def call(method, **params):
    write(1, json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": params}).encode())
    answer = json.loads(read()[1])  # before a subscription only responses arrive
    if "error" in answer:
        sys.exit(answer["error"]["message"])
    return answer["result"]


hello = call("hello", version=1, client="service_client.py")
print(f"# {hello['server']}, master {hello['master']}, access {hello['access']}", flush=True)
call("frames.subscribe")
if len(sys.argv) > 2:
    can_id, data = sys.argv[2].split("#")
    data = bytes.fromhex(data)
    record = struct.pack("<IBBHB3xI", int(can_id, 16), len(data), 0, 0, 0, 1)
    write(3, record + data + bytes(-len(data) % 8))
while True:
    kind, batch = read()
    while kind == 2 and batch:
        time_ns, can_id, length, flags, gateway, channel, event, code, tag = struct.unpack_from("<QIBBHBBHI", batch)
        size = 0 if can_id & 1 << 30 else length  # a remote frame has no data
        data, batch = batch[24 : 24 + size], batch[24 + size + -size % 8 :]
        print(f"{time_ns / 1e9:.6f} {gateway}.{channel} {KINDS[event]} {can_id:03X} [{length}] {data.hex()} tag {tag}", flush=True)
