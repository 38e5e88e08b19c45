#!/usr/bin/env python3
"""Client of a service that ecan zenoh publishes (docs/SERVICE.md, "Other hosts"). Needs eclipse-zenoh.

zenoh_client.py CONFIG PREFIX                        prints CAN frames; at Ctrl-C what arrived and what was lost
zenoh_client.py CONFIG PREFIX send G C ID#DATA [KIND...]
                                                     sends a frame on channel C of gateway G, prints its result;
                                                     KIND: extended, remote, fd, brs, esi (brs and esi imply fd)
zenoh_client.py CONFIG PREFIX METHOD [PARAMETERS]    for example state, sdo.upload '{"slave":0,"index":4096,...}'

ECAN_CLIENT is the name of the client; clients of one name share their turn. Exit status: 0 success, 1 no answer or
an error, 2 wrong arguments.
"""
import json, os, signal, struct, sys, threading, time, zenoh

KINDS = ["received", "transmitted", "failed", "lost", "published", "rejected", "unknown"]
REASONS = ["", "read-only", "no such channel", "CAN FD on a classic channel", "the channel only receives",
           "window full", "transmit queue full", "gateway not ready", "bus or service ended", "late"]
RECORD = struct.Struct("<QIBBHBBHI")  # time, CAN ID, length, flags, gateway, channel, kind, code, tag
CAN_EFF_FLAG, CAN_RTR_FLAG = 1 << 31, 1 << 30
CANFD_BRS, CANFD_ESI, CANFD_FDF = 1, 2, 4
LIFETIME_S = 1.0  # the publisher rejects what it could not begin in this time
REPLY_S = 10.0  # time for a reply after that
client = os.environ.get("ECAN_CLIENT") or f"python-{os.getpid()}"
epochs = []  # starts of the publisher, in the order of their first sample
accounts = {}  # key and epoch: first and highest counters, frames received


def fail(text, status=1):
    sys.stdout.flush()
    print(f"zenoh_client.py: {text}", file=sys.stderr, flush=True)
    os._exit(status)  # does not wait for a network that does not answer


def records(batch):
    while batch:
        fields = RECORD.unpack_from(batch)
        size = 0 if fields[1] & CAN_RTR_FLAG else fields[2]  # a remote frame has no data
        yield fields, batch[24 : 24 + size]
        batch = batch[24 + size + -size % 8 :]


def print_frames(batch):
    """Prints the frames; returns their number and what was not sent."""
    count, failures = 0, []
    for (time_ns, raw, length, flags, gateway, channel, kind, code, _), data in records(batch):
        can_id = f"{raw & 0x1FFFFFFF:08X}" if raw & CAN_EFF_FLAG else f"{raw & 0x7FF:03X}"
        names = [("remote", raw & CAN_RTR_FLAG), ("fd", flags & CANFD_FDF), ("brs", flags & CANFD_BRS),
                 ("esi", flags & CANFD_ESI)]
        text = " ".join([data.hex()] + [name for name, is_set in names if is_set])
        print(f"{time_ns / 1e9:.6f} {gateway}.{channel} {KINDS[kind]} {can_id} [{length}] {text}")
        reason = REASONS[code] if kind == 5 and code < len(REASONS) else f"code {code}"
        if kind not in (1, 4):
            failures.append(f"frame {can_id} {KINDS[kind]}: {reason}")
        count += 1
    sys.stdout.flush()
    return count, failures


def take(sample):
    epoch, connections, before, lost = struct.unpack("<4Q", sample.attachment.to_bytes())
    if epoch not in epochs:
        epochs.append(epoch)
    count, _ = print_frames(sample.payload.to_bytes())
    # A later epoch began with 0 while this client was subscribed.
    first = (before, lost, connections) if epoch == epochs[0] else (0, 0, 1)
    first, highest, received = accounts.get((str(sample.key_expr), epoch), (first, (0, 0, 0), 0))
    highest = tuple(map(max, highest, (before + count, lost, connections)))
    accounts[str(sample.key_expr), epoch] = first, highest, received + count


def print_account():
    for key in sorted({key for key, _ in accounts}):
        ended = [account for (name, _), account in accounts.items() if name == key]
        received = sum(received for _, _, received in ended)
        published, lost, again = (sum(high[at] - first[at] for first, high, _ in ended) for at in range(3))
        print(f"{key}: {received} received, {published - received} lost, {lost} lost in the service (all channels)")
        if again or len(epochs) > 1:
            print(f"{key}: publisher started again {len(epochs) - 1} times, connected again {again} times: "
                  "frames while it was away are not counted", file=sys.stderr)


def get(key, payload=b"", attachment=None, timeout=REPLY_S):
    """All replies; an error reply ends the program."""
    replies = session.get(f"{prefix}/{key}", payload=payload, attachment=attachment, timeout=timeout,
                          target=zenoh.QueryTarget.ALL, consolidation=zenoh.ConsolidationMode.NONE)
    for reply in replies:
        if reply.ok:
            yield reply.ok
            continue
        text = reply.err.payload.to_string()
        try:
            text = json.loads(text)["message"]
        except (ValueError, KeyError, TypeError):
            text = f"no answer from {prefix} within {timeout:g} s ({text})"
        fail(text)


def find_publisher():
    """Identity of the only publisher, and its clock minus the clock of this host."""
    found = {}
    for reply in get("publisher/*"):
        info = json.loads(reply.payload.to_string())
        found[info["publisher"]] = info["now_ns"] - time.monotonic_ns()
    if not found:
        fail(f"no answer from {prefix}: check the prefix, and that ecan zenoh and its service run")
    if len(found) > 1:
        fail(f"{len(found)} publishers use {prefix}: {', '.join(found)}; give each one a --prefix of its own")
    return found.popitem()


def request(method, payload=b""):
    """The only reply of the publisher; the request is rejected if it arrives late."""
    publisher, offset_ns = find_publisher()
    deadline = offset_ns + time.monotonic_ns() + int(LIFETIME_S * 1e9)
    key = f"publisher/{publisher}/{client}/{method}"
    replies = list(get(key, payload, struct.pack("<Q", deadline), LIFETIME_S + REPLY_S))
    if len(replies) != 1:
        fail(f"{len(replies)} answers to {method} from {prefix}; expected: 1; whether it was executed is not known")
    return replies[0].payload


def watch_prefix(tokens, sample):
    token = str(sample.key_expr)
    tokens.discard(token) if sample.kind == zenoh.SampleKind.DELETE else tokens.add(token)
    if len(tokens) > 1:
        fail(f"{len(tokens)} publishers use {prefix}; frames of several machines would be mixed")
    print(f"# {'publisher responds' if tokens else 'publisher away: frames are lost'}", file=sys.stderr)


def observe():
    find_publisher()
    channel = zenoh.handlers.FifoChannel(10_000)
    subscriber = session.declare_subscriber(f"{prefix}/frames/*/*", channel)
    tokens = set()
    watch = session.liveliness().declare_subscriber(
        f"{prefix}/alive/*", lambda sample: watch_prefix(tokens, sample), history=True)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    while not stop.is_set():
        if sample := subscriber.try_recv():
            take(sample)
        else:
            stop.wait(0.01)
    watch.undeclare()
    counters = list(get("frames/*/*"))
    while sample := subscriber.try_recv():
        take(sample)
    for sample in counters:  # after all that was published before
        take(sample)
    print_account()
    if not counters:
        fail(f"no answer from {prefix} at the end: frames lost after the last ones are not counted")


def send(gateway, channel, frame, *kinds):
    if wrong := set(kinds) - {"extended", "remote", "fd", "brs", "esi"}:
        raise ValueError(f"frame kind {', '.join(wrong)} is not known; allowed: extended, remote, fd, brs, esi")
    can_id, data = frame.split("#")
    data = bytes.fromhex(data)
    raw = int(can_id, 16)
    if len(can_id) == 8 or raw > 0x7FF or "extended" in kinds:
        raw |= CAN_EFF_FLAG
    if "remote" in kinds:
        raw |= CAN_RTR_FLAG
    flags = (CANFD_BRS if "brs" in kinds else 0) | (CANFD_ESI if "esi" in kinds else 0)
    if flags or "fd" in kinds:
        flags |= CANFD_FDF
    record = struct.pack("<IBBHB3xI", raw, len(data), flags, int(gateway), int(channel.removeprefix("can")), 1)
    count, failures = print_frames(request("send", record + data + bytes(-len(data) % 8)).to_bytes())
    if failures or count != 1:
        fail("; ".join(failures) or f"{count} results; expected: 1")


if len(sys.argv) < 3 or (sys.argv[3:4] == ["send"] and len(sys.argv) < 7):
    fail(__doc__.strip(), 2)
config, prefix, *rest = sys.argv[1:]
try:
    session = zenoh.open(zenoh.Config.from_file(config))
    if not rest:
        observe()
    elif rest[0] == "send":
        send(*rest[1:])
    else:
        print(request(rest[0], "".join(rest[1:]).encode()).to_string())
    session.close()
except ValueError as error:
    fail(error, 2)
except zenoh.ZError as error:
    fail(error)
