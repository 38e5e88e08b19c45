#!/usr/bin/env bash
# Runs the benchmarks, prints one table of ratios, and writes it with the machine and the date between the
# marks of docs/PERFORMANCE.md. The details and the method of each row are written to target/performance.txt.
# Other load on the machine distorts the figures.
#
#     scripts/measure-performance.sh
#
# OTHER_SIMULATOR="--other IFACE" compares the turnaround of ecan-sim wire with that of another slave
# simulator, which answers at the other end of the veth pair IFACE (target/performance.txt, Turnaround).
#
# Needs a C compiler for the plain C codec, and for the wake-up rows cyclictest and permission for
# SCHED_FIFO.
set -euo pipefail
cd "$(dirname "$0")/.."
document=docs/PERFORMANCE.md
details=target/performance.txt

checks=(--manifest-path checks/Cargo.toml --target-dir target)
bench() { cargo bench --quiet --locked "${checks[@]}" -p ecan-bench --bench "$1" -- "${@:2}"; }
# Benchmarks mark table rows with "= ".
rows() { sed -n 's/^= //p' <<<"$1" | tail -n +2; }
details() { grep -v '^= ' <<<"$1" || true; }
has_goal() { awk -F'|' '$3 !~ /^ *$/'; }
has_no_goal() { awk -F'|' '$3 ~ /^ *$/'; }

cargo bench --quiet --locked --no-run "${checks[@]}" -p ecan-bench --benches
load_before=$(cut -d' ' -f1-2 /proc/loadavg)
codec=$(bench codec)
cycle=$(bench cycle)
axes=$(bench axes)
cycle_cpu=$(bench cycle_cpu)
simulation=$(bench simulation)
c_face=$(bench c_face)
clients=$(bench clients)

turnaround='| turnaround on veth, p50 | 1 | not measured in this run | | ecan-sim wire / another slave simulator |
| turnaround on veth, p99 | 1 | not measured in this run | | ecan-sim wire / another slave simulator |'
# shellcheck disable=SC2086 # several arguments
turnaround_details=$(bench turnaround ${OTHER_SIMULATOR:-})
measured=$(rows "$turnaround_details")
turnaround=${measured:-$turnaround}
turnaround_details=$(details "$turnaround_details")

wake_up='| wake-up at 1 ms, p50 | 1.1 | not measured in this run | | cycle timer / cyclictest |
| wake-up at 1 ms, p99 | 1.2 | not measured in this run | | cycle timer / cyclictest |
| wake-up at 1 ms, p99, 100 us spin | 0.1 | not measured in this run | | cycle timer / cyclictest |'
wake_up_details=$(bench wake_up)
measured=$(rows "$wake_up_details")
wake_up=${measured:-$wake_up}
wake_up_details=$(details "$wake_up_details")

# axes cycle "us" frames load "%" median ...
simulated=$(awk '$3 == "us" {
    goal = $2 > 1000 ? 500 : $1 > 10 ? 80 : 200
    printf "| simulator, %s axes, %.0f frames in a cycle of %s us | at least %s | %s%s | | simulated / wall-clock time |\n",
        $1, $4, $2, goal, $7, $7 < goal ? " (missed)" : ""
}' <<<"$simulation")

table="| measure | goal | accelerated | portable | what |
|---|---|---:|---:|---|
$(rows "$codec" | has_goal)
$(rows "$cycle")
$(rows "$axes")
$(rows "$cycle_cpu")
$(rows "$clients")
$simulated
$turnaround
$wake_up
$(rows "$c_face")"
echo "$table"

of_cpu() { lscpu | sed -n "s/^$1: *//p" | head -1; }

measured=$(mktemp)
trap 'rm -f "$measured"' EXIT
{
    echo "$(date -u +%F), $(of_cpu 'Model name') family $(of_cpu 'CPU family') model $(of_cpu 'Model'), $(nproc) cores," \
        "last-level cache $(of_cpu 'L3 cache' | sed 's/ (.*//'), $(uname -sr), $(rustc --version)," \
        "$(gcc --version | head -1), load (1 and 5 minutes) before the run $load_before:"
    printf '\n%s\n' "$table"
} >"$measured"
sed -i -e "/^<!-- measured -->\$/,/^<!-- end of measured -->\$/{//!d}" -e "/^<!-- measured -->\$/r $measured" "$document"

cat >"$details" <<TEXT
## PDO image codec

Time of this codec relative to a plain C codec (\`checks/benches/src/baseline\`: CRC by a table of
256 entries, byte by byte; the image cleared whole; compiled with -O3). Both write the same bytes and
read the same packets. The benchmark writes an image from prepared frames, then validates and reads it without
a copy, including channel, CAN ID, length and first data byte of each frame.

$(details "$codec")

Before each cold call the benchmark reads one byte of every cache line of a buffer. A buffer of twice the
second-level cache evicts frames, image, tables and code to the last-level cache; a buffer of twice the
last-level cache evicts them to memory.

Wire time is that of an RxPDO and a TxPDO image of N x 128 bytes each at 100 Mbit/s, 80 ns per byte:
\`bytes = 2 x 128 x N + 52 x frames\`, \`frames = ceil(2 x 128 x N / 1486)\`. The 52 bytes around the
data are preamble and start (8), Ethernet header (14), EtherCAT header (2), datagram header and working
counter (12), check sequence (4) and gap (12). The images are full of frames of 8 bytes; the benchmark
writes one and reads one.

CRC of short inputs, without a goal:

| measure | goal | accelerated | portable | what |
|---|---|---:|---:|---|
$(rows "$codec" | has_no_goal)

    cargo bench --manifest-path checks/Cargo.toml --bench codec

## Whole cycle

\`cycle_begin\`, receive everything, send, \`cycle_end\` of a Port on a master without data exchange
(\`checks/benches/src/null_master\`): its functions only return success and increment the sequence of each TxPDO image.
The other side is the codec alone with the same images. The Port adds sessions, working counters,
image sequence, checks of channel and frame, tickets and statistics.

    cargo bench --manifest-path checks/Cargo.toml --bench cycle

## CiA 402 axes

\`process_rx\` and \`send_targets_all\`, without begin and end of the cycle. The benchmark
repeats a cycle in which every axis sent its TPDO; every axis follows targets at standstill. Four axes on a channel,
sixteen on a gateway: ten are on one gateway, forty on three.

The snapshot for observers is measured in whole cycles with N = 3: wait, begin, \`process_rx\`, a target per axis,
\`send_targets_all\`, end. The same Port runs with an observer and without one.

$(details "$axes")

    cargo bench --manifest-path checks/Cargo.toml --bench axes

## Processor time of a cycle

Processor time of the thread in a cycle of 1 ms with three gateways, N = 3, and ten axes, which follow targets of the
application. The thread sleeps until each cycle. The wait, which every program with a cycle has, and the calls of the
library are separate; the null master has no calls.

\`\`\`text
$(details "$cycle_cpu")
\`\`\`

    cargo bench --manifest-path checks/Cargo.toml --bench cycle_cpu

## Service

Run time of a cycle with N = 3 and 10 frames in each direction, of a Port whose service has eight clients relative to
one without a service: six read all frames, one polls the state, one never reads. One cycle per millisecond, of both in
turn. The simulated master stands for the system calls of a real one; the null master has none.

\`\`\`text
$(details "$clients")
\`\`\`

    cargo bench --manifest-path checks/Cargo.toml --bench clients

## Simulator

Simulated time relative to wall-clock time, in stepped time, including host and bit-exact buses.

\`\`\`text
$simulation
\`\`\`

    cargo bench --manifest-path checks/Cargo.toml --bench simulation

## Turnaround

Time from the call that sends an EtherCAT frame to the arrival of the response, on a veth pair, one frame per millisecond
(BRD of 2 bytes, FPRD of 8, LRW of 768 in turn). Segments of \`ecan-sim wire\` and of another slave simulator alternate;
the figure is the median of the ratios of adjacent segments.

\`\`\`text
$turnaround_details
\`\`\`

    cargo bench --manifest-path checks/Cargo.toml --bench turnaround -- --other IFACE [--rt-priority N]

## Wake-up

Delay of the cycle start at a period of 1 ms. Segments of the cycle timer and of \`cyclictest\`
alternate; the figure is the median of the ratios of adjacent segments.

\`\`\`text
$wake_up_details
\`\`\`

    cargo bench --manifest-path checks/Cargo.toml --bench wake_up

## C interface

Cost of a call through the C functions relative to the Rust call.

\`\`\`text
$(details "$c_face")
\`\`\`

    cargo bench --manifest-path checks/Cargo.toml --bench c_face
TEXT
