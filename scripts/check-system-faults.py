#!/usr/bin/env python3
"""Runs the programs while the system fails.

    scripts/check-system-faults.py [--programs DIRECTORY] [--most N] [--only TEXT]

Each system call of a kind fails once, in a run of its own (strace). In runs in real time the process is paused, the
clock of the system is set by an hour, the terminal goes away, or memory is short.

A run must end in time, by an exit status of the program, without panic; an error is one message; a file that it
writes is whole or absent; a frame that counts as sent was on the bus; a motor that moved is off, or a message says
what stops it. Prints a table of programs and faults with the number of runs and their statuses. --most limits the
runs of a cell [default: 40], spread over all calls.
"""
import argparse
import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Longest run; the programs take two seconds or less.
LIMIT_S = 60
# Longer than the watchdog of the gateways, 100 ms.
PAUSE_S = 0.3
# Moves the clock of the system by the hours in the file HOURS; other clocks go on.
CLOCK_SOURCE = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
    int status = real(clock, now);
    char text[8] = "";
    if (status != 0 || clock != CLOCK_REALTIME) return status;
    int file = open(getenv("HOURS"), O_RDONLY);
    if (file >= 0 && read(file, text, sizeof text - 1) > 0) now->tv_sec += 3600 * atoi(text);
    if (file >= 0) close(file);
    return 0;
}
"""
AXIS = ["--node", "1", "--unit", "step", "--max-velocity", "1000", "--range", "-9999..9999", "--yes"]


class Program:
    """A command with the files that it writes; with a client, a service that runs until it is stopped."""

    def __init__(self, name, command, files=None, checks=None, client=None):
        self.name, self.command, self.files = name, [str(word) for word in command], files or {}
        self.checks, self.client = checks, client

    def clear(self):
        for file in self.files:
            file.unlink(missing_ok=True)


def programs(folder, work, echo, drives):
    """With the settings of the library for gateways that return all frames, and for drives."""
    tool, drive = [folder / "ecan", "--ecrt", echo], [folder / "ecan", "--ecrt", drives]
    log, pcap, bundle = work / "frames.log", work / "frames.pcapng", work / "bundle.json"
    socket = work / "service.sock"
    generate = ["gen", "-n", "20", "-g", "1", "--json"]
    loop = [folder / "examples/simple_loop", "--ecrt", echo, "--cycles", "50", "--dump", log]
    return [
        Program("info", [*tool, "info", "--json"]),
        Program("diag --record", [*tool, "diag", "--record", bundle], {bundle: is_json}),
        Program("config check", [folder / "ecan", "config", "check", work / "cell.toml"]),
        Program("config apply", [*tool, "config", "apply", work / "cell.toml"]),
        Program("gen --capture", [*tool, *generate, "--capture", pcap], {pcap: is_pcapng}, counts_are_true),
        Program("replay --record", [*tool, "replay", work / "recording.log", "--record", log], {log: is_log}),
        Program("selftest", [*tool, "selftest", "--observe", "1", "--frames", "4"]),
        Program("node scan", [*drive, "node", "scan", "--nodes", "1-8"]),
        Program("monitor", [*tool, "monitor", "--for", "0.2s", "--json"]),
        Program("axis move", [*drive, "axis", "move", "--by", "100", *AXIS, "--unattended"], checks=motor_is_off),
        Program("simple_loop --dump", loop, {log: is_log}),
        Program(
            "serve", [*tool, "serve", "--socket", socket], checks=counts_add_up,
            client=[str(folder / "ecan"), "--via", str(socket), *generate],
        ),
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


def report_of(out):
    """Of gen; None for an error, or output that could not be written."""
    try:
        return json.loads(out) if "error" not in out else None
    except ValueError:
        return None


def counts_add_up(out, _):
    report = report_of(out)
    return not report or sum(report[name] for name in ("sent", "lost", "under_way")) == report["frames"]


def counts_are_true(out, err):
    """The nodes return each frame that was on the bus."""
    report = report_of(out)
    has_all_images = report and report["images_lost"] == report["images_unknown"] == 0
    return counts_add_up(out, err) and (not has_all_images or report["sent"] <= report["received"])


def motor_is_off(out, err):
    return "moving" not in err or re.search(": off|not moving|by itself|ecan:|moved from", out + err)


# Calls, error, and whether the program must then do its work all the same.
INJECTED = [
    ("no descriptor", "openat,socket,pipe2,epoll_create1,eventfd2,timerfd_create,accept4", "EMFILE", False),
    ("no permission", "openat,connect,bind,mlockall,sched_setscheduler", "EACCES", False),
    ("no thread", "clone,clone3", "EAGAIN", False),
    ("disk full", "write,pwrite64,writev,fsync,fdatasync", "ENOSPC", False),
    ("device error", "read,pread64,write,lseek,fsync,rename,renameat2", "EIO", False),
    ("broken pipe", "write,sendto,sendmsg", "EPIPE", False),
    ("interrupted", "read,write,poll,ppoll,openat,clock_nanosleep,accept4,recvfrom,sendto", "EINTR", True),
]


class Run:
    """A program that runs, under strace with a fault to inject, or with an event after some time."""

    def __init__(self, work, program, inject=None, environment=None, limit=None, terminal=None):
        self.program, self.trace = program, work / "trace"
        command, self.is_traced = program.command, inject is not None
        if self.is_traced:
            command = ["strace", "-f", "-qq", "-o", str(self.trace), *inject, *command]
        ends = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        if terminal is not None:
            ends = dict.fromkeys(ends, terminal)
        home = {"ECAN_ECRT": "", "HOME": str(work), "XDG_RUNTIME_DIR": str(work)}
        self.begun = time.monotonic()
        self.process = subprocess.Popen(
            command, **ends, env={**os.environ, **home, **(environment or {})}, start_new_session=True,
            preexec_fn=None if limit is None else lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        )

    def pid(self):
        if not self.is_traced:
            return self.process.pid
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return int(children[0])

    def signal(self, number):
        try:
            os.kill(self.pid(), number)
        except (IndexError, OSError):
            pass  # It has ended.

    def has_ended(self, wait_s):
        try:
            return self.process.wait(wait_s) is not None
        except subprocess.TimeoutExpired:
            return False

    def finish(self):
        """Status, output, errors and seconds; no status if it did not end."""
        seconds, client = None, ["", ""]
        try:
            if self.program.client:
                client, seconds = self.run_client()
                # The call with which a handler reports the first signal may be the one that fails.
                for wait_s in (5, 0):
                    self.signal(signal.SIGTERM)
                    if self.has_ended(wait_s):
                        break
            out, err = self.process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.communicate()
            return None, "", "", LIMIT_S
        texts = [(of or b"").decode(errors="replace") for of in (out, err)]
        seconds = seconds or time.monotonic() - self.begun
        return self.process.returncode, client[0] or texts[0], client[1] + texts[1], seconds

    def run_client(self):
        """Of the service, which may need some time or end."""
        end = self.begun + LIMIT_S
        while True:
            client = subprocess.run(self.program.client, capture_output=True, text=True, timeout=LIMIT_S)
            has_started = client.returncode != 3
            if has_started or self.process.poll() is not None or time.monotonic() > end:
                if client.returncode not in range(8) or "panicked" in client.stderr:
                    return ["", f"panicked? client: status {client.returncode}: {client.stderr}"], None
                return [client.stdout, client.stderr], time.monotonic() - self.begun
            time.sleep(0.02)


class Table:
    def __init__(self, options, work):
        self.options, self.work, self.faults = options, work, []

    def judge(self, program, status, out, err, must_work=False, signals=()):
        """What is wrong with the end of a run."""
        if status is None:
            return "no end"
        if -status in signals:
            return None
        if not 0 <= status <= 7 or "panicked" in err or "RUST_BACKTRACE" in err:
            return f"status {status}: {err.strip()[-300:]}"
        if status not in (0, 1) and not err.strip():
            return f"status {status} without a message"
        if must_work and status != 0:
            return f"status {status}: {err.strip()[-300:]}"
        for file, is_whole in program.files.items():
            try:
                if file.exists() and not is_whole(file.read_bytes()):
                    return f"{file.name} is damaged"
            except ValueError:
                return f"{file.name} is damaged"
        if program.checks and not program.checks(out, err):
            return f"status {status}: {out} {err.strip()[-600:]}"
        return None

    def cell(self, program, what, runs, must_work=False, signals=()):
        """The statuses of runs: pairs of a name and a function that gives the ended run."""
        statuses = set()
        for name, run in runs:
            program.clear()
            status, out, err, _ = run()
            statuses.add(status)
            wrong = self.judge(program, status, out, err, must_work, signals)
            if wrong:
                self.faults.append(f"{program.name}, {what}, {name}: {wrong}")
                print(self.faults[-1], file=sys.stderr, flush=True)
        return f"{len(runs)}: {', '.join(map(str, sorted(statuses, key=str)))}" if runs else ""

    def undisturbed(self, program, inject=None):
        program.clear()
        status, _, err, seconds = Run(self.work, program, inject).finish()
        if status != 0:
            sys.exit(f"{program.name} without a fault: status {status}: {err}")
        return seconds

    def injected(self, program):
        """Cells of failed calls."""
        self.undisturbed(program, [])
        lines = (self.work / "trace").read_text(errors="replace").splitlines()
        names = [match[1] for match in (re.match(r"\d+ +(\w+)\(", line) for line in lines) if match]
        # The loader ends when it releases the cache of its paths.
        loader = names.index("munmap") + 1
        for what, calls, error, must_work in INJECTED:
            of_kind = [at for at, call in enumerate(names) if call in calls.split(",")]
            first = sum(at < loader for at in of_kind) + 1
            numbers = range(first, len(of_kind) + 1, max(1, (len(of_kind) - first) // self.options.most))

            def run(number, calls=calls, error=error):
                inject = ["-e", f"trace={calls}", "-e", f"inject={calls}:error={error}:when={number}"]
                return Run(self.work, program, inject).finish()

            runs = [(f"call {number} of {len(of_kind)}", lambda number=number: run(number)) for number in numbers]
            yield self.cell(program, what, runs, must_work)

    def moments(self, program):
        """Cells of events at moments spread over a run in real time."""
        seconds, count = self.undisturbed(program), min(8, self.options.most)
        moments = [seconds * nth / count for nth in range(count)]

        def pause(at):
            run = Run(self.work, program)
            time.sleep(at)
            run.signal(signal.SIGSTOP)
            time.sleep(PAUSE_S)
            run.signal(signal.SIGCONT)
            return run.finish()

        def set_clock(at, hours):
            clock = self.work / "clock"
            clock.write_text("0")
            library = str(self.work / "clock.so")
            run = Run(self.work, program, environment={"LD_PRELOAD": library, "HOURS": str(clock)})
            time.sleep(at)
            clock.write_text(str(hours))
            return run.finish()

        def close_terminal(at):
            ours, theirs = pty.openpty()
            run = Run(self.work, program, terminal=theirs)
            os.close(theirs)
            time.sleep(at)
            os.close(ours)
            run.signal(signal.SIGHUP)
            status, out, _, seconds = run.finish()
            return status, out, "(nobody reads errors)", seconds

        def at_moments(function, *arguments):
            return [(f"after {at:.2f} s", lambda at=at: function(at, *arguments)) for at in moments]

        yield self.cell(program, "paused", at_moments(pause))
        for hours in (1, -1):
            yield self.cell(program, f"clock {hours:+} h", at_moments(set_clock, hours), must_work=True)
        yield self.cell(program, "terminal gone", at_moments(close_terminal), signals=[signal.SIGHUP])

    def short_memory(self, program):
        """A limit of the address space, from what the start of the program needs."""
        def run(limit, program=program):
            return Run(self.work, program, limit=limit << 20).finish()

        version = Program("", [program.command[0], "--version"])
        least = next(limit for limit in range(4, 1024, 4) if run(limit, version)[0] == 0)
        limits = [least + (more << 1) for more in (0, 1, 2, 4, 8, 16, 32)]
        runs = [(f"{limit} MB", lambda limit=limit: run(limit)) for limit in limits]
        # An allocation, or a stack that cannot grow.
        return self.cell(program, "memory", runs, signals=[signal.SIGABRT, signal.SIGSEGV])


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
        for kind in ("echo", "drive"):
            nodes = f'[[node]]\nkind = "{kind}"\nbus = "0.0"\n' + ("node_id = 1\n" if kind == "drive" else "")
            (work / f"{kind}.toml").write_text(f'clock = "real"\n[[gateway]]\n{nodes}')
        (work / "clock.c").write_text(CLOCK_SOURCE)
        subprocess.run(["cc", "-shared", "-fPIC", "-o", work / "clock.so", work / "clock.c"], check=True)
        table = Table(options, work)
        events = ["paused", "clock +1 h", "clock -1 h", "terminal gone", "memory"]
        heads = ["program", *(fault[0] for fault in INJECTED), *events]
        print("| " + " | ".join(heads) + " |\n" + "| --- " * len(heads) + "|")
        stepped = programs(options.programs, work, "sim:echo", "sim:drives")
        real = programs(options.programs, work, f"sim:{work}/echo.toml", f"sim:{work}/drive.toml")
        for program, in_real_time in zip(stepped, real):
            if options.only in program.name:
                cells = [*table.injected(program), *table.moments(in_real_time), table.short_memory(program)]
                print(f"| {program.name} | " + " | ".join(cells) + " |", flush=True)
        sys.exit(1 if table.faults else 0)


main()
