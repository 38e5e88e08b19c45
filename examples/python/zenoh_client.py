#!/usr/bin/env python3
"""Client of a service that ecan zenoh publishes (docs/SERVICE.md, "Other hosts"). Needs eclipse-zenoh.

zenoh_client.py CONFIG PREFIX                        prints CAN frames; at Ctrl-C what arrived and what was lost
zenoh_client.py CONFIG PREFIX send G C ID#DATA       sends a frame on channel C of gateway G, prints its result
zenoh_client.py CONFIG PREFIX METHOD [PARAMETERS]    for example state, sdo.upload '{"slave":0,"index":4096,...}'
"""
import signal, struct, sys, threading, zenoh

KINDS = ["received", "transmitted", "failed", "lost", "published", "rejected", "unknown"]
RECORD = struct.Struct("<QIBBHBBHI")  # time, CAN ID, length, flags, gateway, channel, kind, code, tag
accounts = {}  # key and epoch: frames before the first sample, published, received; lost in the service


def print_frames(batch):
    count = 0
    while batch:
        time_ns, can_id, length, flags, gateway, channel, kind, code, tag = RECORD.unpack_from(batch)
        size = 0 if can_id & 1 << 30 else length  # a remote frame has no data
        data, batch = batch[24 : 24 + size], batch[24 + size + -size % 8 :]
        print(f"{time_ns / 1e9:.6f} {gateway}.{channel} {KINDS[kind]} {can_id:03X} [{length}] {data.hex()}")
        count += 1
    sys.stdout.flush()
    return count


def take(sample):
    epoch, before, lost = struct.unpack("<QQQ", sample.attachment.to_bytes())
    count = print_frames(sample.payload.to_bytes())
    account = accounts.setdefault((str(sample.key_expr), epoch), [before, before, 0, lost])
    account[1:] = [max(account[1], before + count), account[2] + count, lost]


def get(key, payload=b""):
    for reply in session.get(f"{prefix}/{key}", payload=payload, timeout=10):
        if not reply.ok:
            sys.exit(reply.err.payload.to_string())
        yield reply.ok


config, prefix, *request = sys.argv[1:]
session = zenoh.open(zenoh.Config.from_file(config))
if not request:
    subscriber = session.declare_subscriber(f"{prefix}/frames/*/*", zenoh.handlers.FifoChannel(10_000))
    stop = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    while not stop.is_set():
        if sample := subscriber.try_recv():
            take(sample)
        else:
            stop.wait(0.01)
    counters = list(get("frames/*/*"))
    while sample := subscriber.try_recv():
        take(sample)
    for sample in counters:  # after all that was published before
        take(sample)
    for (key, epoch), (first, published, received, lost) in sorted(accounts.items()):
        print(f"{key}: {received} received, {published - first - received} lost, {lost} lost in the service (all channels)")
elif request[0] == "send":
    gateway, channel, frame = request[1:]
    can_id, data = frame.split("#")
    data = bytes.fromhex(data)
    record = struct.pack("<IBBHB3xI", int(can_id, 16), len(data), 0, int(gateway), int(channel), 1)
    for reply in get("send", record + data + bytes(-len(data) % 8)):
        print_frames(reply.payload.to_bytes())
else:
    replies = list(get(request[0], "".join(request[1:]).encode())) or sys.exit(f"no answer from {prefix}")
    print(replies[0].payload.to_string())
session.close()
