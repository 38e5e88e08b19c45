#!/usr/bin/env python3
"""Runs the soak test and the motion trials on seeds that were never run, for 10^8 cycles each: the long run of a release.

    scripts/run-long.py [--cycles N] [--only soak|trials] [--records FILE]

Each finished batch is a line of the records [default: target/long-run.json]: first seed, seeds, cycles, seconds, and
memory and descriptors of the process: most in its first quarter, least in its last one. Started again, the script continues after
the last line. It fails at a finding, and if memory or descriptors grow in a batch.
"""
import argparse
import json
import os
import random
import re
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Program, seeds of a batch, cycles in its output, and how its seeds are given.
SOAK = ("soak", 400, r"(\d+) cycles of", lambda binary, first, count: (
    [binary, "--seed", str(first), "--seeds", str(count), "--output", "target"], {}))
TRIALS = ("trials", 2000, r"with violations, (\d+) cycles", lambda binary, first, count: (
    [binary, "random_trials_violate_no_rule", "--nocapture"],
    {"TRIALS_FIRST": str(first), "TRIALS_COUNT": str(count)}))


def build():
    """Paths of the two programs."""
    soak = ["cargo", "build", "--release", "--locked", "--manifest-path", "checks/Cargo.toml", "--target-dir", "target",
            "-p", "ecan-soak"]
    subprocess.run(soak, cwd=ROOT, check=True)
    trials = ["cargo", "test", "--release", "--locked", "-p", "ecan-cia402", "--test", "trials", "--no-run",
              "--message-format", "json"]
    lines = subprocess.run(trials, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    binaries = [message.get("executable") for message in map(json.loads, lines)]
    return str(ROOT / "target/release/ecan-soak"), next(filter(None, reversed(binaries)))


def use_of(pid):
    """Resident memory in KiB and open descriptors of a process, or none if it has ended."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1]), len(os.listdir(f"/proc/{pid}/fd"))
    except (OSError, TypeError):
        return None


def run_batch(kind, binary, start):
    name, count, pattern, command_of = kind
    command, environment = command_of(binary, start, count)
    begun, uses = time.time(), []
    with open(ROOT / f"target/long-run-{name}.log", "w+") as log:
        process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, **environment}, stdout=log, stderr=log)
        try:
            while process.poll() is None:
                uses.append(use_of(process.pid))
                time.sleep(0.5)
        except KeyboardInterrupt:
            process.kill()
            process.wait()
            sys.exit("interrupted; the batch will be run again")
        log.seek(0)
        output = log.read()
    if process.returncode != 0:
        sys.exit(f"{name}, seeds {start} to {start + count - 1}: status {process.returncode}\n{output[-3000:]}")
    uses = list(filter(None, uses))
    first, last = uses[: len(uses) // 4 + 1], uses[-(len(uses) // 4 + 1) :]
    growth = {}
    # The allocator keeps what the largest trial needed; what leaks grows with each trial.
    for at, what in enumerate(("memory_kib", "descriptors")):
        most_first, least_last = max(use[at] for use in first), min(use[at] for use in last)
        growth[what] = [most_first, least_last]
        if least_last > 2 * most_first:
            sys.exit(f"{name}, seeds {start} to {start + count - 1}: {what} grow from {most_first} to {least_last}")
    return {
        "kind": name, "first": start, "seeds": count, "cycles": int(re.findall(pattern, output)[-1]),
        "seconds": round(time.time() - begun), **growth,
    }


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--cycles", type=int, default=100_000_000)
    parser.add_argument("--only", choices=["soak", "trials"])
    parser.add_argument("--records", type=Path, default=ROOT / "target/long-run.json")
    options = parser.parse_args()
    options.records.parent.mkdir(exist_ok=True)
    options.records.touch()
    records = [json.loads(line) for line in options.records.read_text().splitlines()]
    for kind, binary in zip((SOAK, TRIALS), build()):
        name = kind[0]
        if options.only not in (None, name):
            continue
        done = [record for record in records if record["kind"] == name]
        cycles = sum(record["cycles"] for record in done)
        first = done[-1]["first"] + done[-1]["seeds"] if done else random.randrange(1 << 24, 1 << 40)
        while cycles < options.cycles:
            record = run_batch(kind, binary, first)
            with options.records.open("a") as file:
                file.write(json.dumps(record) + "\n")
            cycles, first = cycles + record["cycles"], first + record["seeds"]
            print(f"{name}: {cycles} of {options.cycles} cycles, seeds up to {first - 1}", flush=True)


main()
