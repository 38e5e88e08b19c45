#!/usr/bin/env python3
"""Runs the programs while the system fails: each call of a kind fails once, in a run of its own, by strace.

    scripts/check-system-faults.py [--programs DIRECTORY] [--most N] [--only TEXT]

A run must end in time, by an exit status of the program, without panic; an error is one message; a file that it
writes is whole or absent; a call that was only interrupted changes nothing. Prints a table of programs and faults.
Needs strace. --most limits the runs of a cell [default: 40], spread over all calls.
"""
import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Longest run; the programs take a second or less.
LIMIT_S = 60

# Name, arguments, files that it writes, and how each is checked.
def programs(folder, work):
    ecan = [folder / "ecan", "--ecrt", "sim:echo"]
    drives = [folder / "ecan", "--ecrt", "sim:drives"]
    log, pcap, bundle = work / "frames.log", work / "frames.pcapng", work / "bundle.json"
    return [
        ("info", [*ecan, "info", "--json"], {}),
        ("diag --record", [*ecan, "diag", "--record", bundle], {bundle: is_json}),
        ("config check", [folder / "ecan", "config", "check", work / "cell.toml"], {}),
        ("config apply", [*ecan, "config", "apply", work / "cell.toml"], {}),
        ("gen --capture", [*ecan, "gen", "-n", "20", "-g", "1", "--capture", pcap], {pcap: is_pcapng}),
        ("replay --record", [*ecan, "replay", work / "recording.log", "--record", log], {log: is_log}),
        ("selftest", [*ecan, "selftest", "--observe", "1", "--frames", "4"], {}),
        ("node scan", [*drives, "node", "scan"], {}),
        ("monitor", [*ecan, "monitor", "--for", "0.2", "--json"], {}),
        ("simple_loop --dump", [folder / "examples/simple_loop", "--ecrt", "sim", "--cycles", "50", "--dump", log], {log: is_log}),
    ]


def is_json(text):
    json.loads(text)
    return True


def is_log(text):
    return not text or text.endswith(b"\n") and all(
        re.fullmatch(rb"\(\d+\.\d+\) \S+ \S+( [RT])?", line) for line in text.splitlines()
    )


def is_pcapng(data):
    """All blocks are whole."""
    at = 0
    while at < len(data):
        length = int.from_bytes(data[at + 4 : at + 8], "little")
        if length < 12 or data[at + length - 4 : at + length] != data[at + 4 : at + 8]:
            return False
        at += length
    return True


# Calls, error, and whether the program must then do its work all the same.
FAULTS = [
    ("no descriptor", "openat,socket,pipe2,epoll_create1,eventfd2,timerfd_create", "EMFILE", False),
    ("no permission", "openat,connect,bind,mlockall,sched_setscheduler", "EACCES", False),
    ("no thread", "clone,clone3", "EAGAIN", False),
    ("disk full", "write,pwrite64,writev,fsync,fdatasync", "ENOSPC", False),
    ("device error", "read,pread64,write,lseek,fsync,rename,renameat2", "EIO", False),
    ("interrupted", "read,write,poll,ppoll,openat,clock_nanosleep,accept4,recvfrom,sendto", "EINTR", True),
]


class Runs:
    def __init__(self, options, work):
        self.options, self.work, self.faults = options, work, []

    def run(self, command, inject=None):
        trace = self.work / "trace"
        strace = ["strace", "-f", "-qq", "-o", str(trace)]
        if inject:
            calls, error, number = inject
            strace += ["-e", f"trace={calls}", "-e", f"inject={calls}:error={error}:when={number}"]
        environment = {**os.environ, "ECAN_ECRT": "", "HOME": str(self.work), "XDG_RUNTIME_DIR": str(self.work)}
        process = subprocess.Popen(
            [*strace, *map(str, command)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env=environment, start_new_session=True,
        )
        try:
            out, err = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return None, "", "no end", []
        lines = trace.read_text(errors="replace").splitlines()
        return process.returncode, out.decode(errors="replace"), err.decode(errors="replace"), lines

    def judge(self, status, err, files, must_work):
        if status is None:
            return "no end"
        if status < 0 or status > 128:
            return f"ended by signal {status}"
        if status > 7 or "panicked" in err or "RUST_BACKTRACE" in err:
            return f"status {status}: {err.strip()[:200]}"
        if status not in (0, 1) and not err.strip():
            return f"status {status} without a message"
        if must_work and status != 0:
            return f"status {status}: {err.strip()[:200]}"
        for file, is_whole in files.items():
            try:
                if file.exists() and not is_whole(file.read_bytes()):
                    return f"{file.name} is damaged"
            except ValueError:
                return f"{file.name} is damaged"
        return None

    def calls_of(self, name, command, files):
        """Names of the calls of an undisturbed run, and how many of them the loader makes."""
        clear(files)
        status, _, err, lines = self.run(command)
        if status != 0:
            sys.exit(f"{name} without a fault: status {status}: {err}")
        names = [match[1] for match in (re.match(r"\d+ +(\w+)\(", line) for line in lines) if match]
        # The loader ends when it releases the cache of its paths.
        return names, names.index("munmap") + 1

    def cell(self, name, command, files, names, loader, fault):
        what, calls, error, must_work = fault
        of_kind = [at for at, call in enumerate(names) if call in calls.split(",")]
        count, first = len(of_kind), sum(at < loader for at in of_kind) + 1
        step = max(1, (count - first) // self.options.most)
        statuses = set()
        for number in range(first, count + 1, step):
            clear(files)
            status, _, err, _ = self.run(command, (calls, error, number))
            statuses.add(status)
            wrong = self.judge(status, err, files, must_work)
            if wrong:
                self.faults.append(f"{name}, {what}, call {number} of {count}: {wrong}")
        runs = range(first, count + 1, step)
        return f"{len(runs)} of {count - first + 1}: {', '.join(map(str, sorted(statuses, key=str)))}" if runs else ""


def clear(files):
    for file in files:
        file.unlink(missing_ok=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--programs", type=Path, default=ROOT / "target/debug")
    parser.add_argument("--most", type=int, default=40)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        (work / "cell.toml").write_text("[[gateway]]\n[gateway.can0]\nbitrate = 1_000_000\n")
        (work / "recording.log").write_text("".join(f"({nth / 1000:.6f}) can0 123#{nth:02X}\n" for nth in range(20)))
        runs = Runs(options, work)
        print("| program | " + " | ".join(fault[0] for fault in FAULTS) + " |")
        print("| --- " * (len(FAULTS) + 1) + "|")
        for name, command, files in programs(options.programs, work):
            if options.only in name:
                calls = runs.calls_of(name, command, files)
                cells = [runs.cell(name, command, files, *calls, fault) for fault in FAULTS]
                print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
        for fault in runs.faults:
            print(fault, file=sys.stderr)
        sys.exit(1 if runs.faults else 0)


main()
