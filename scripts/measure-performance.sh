#!/usr/bin/env bash
# Runs the benchmarks, prints one table of ratios, and writes it with the details, the machine and
# the date into docs/PERFORMANCE.md. What that file says from "## Remarks" on is kept: it is written
# by hand. Other load on the machine spoils the figures.
#
#     scripts/measure-performance.sh
#
# Needs a C compiler for the plain C codec that the codec is measured against; and, for the rows of
# the wake-up, cyclictest and the right to SCHED_FIFO.
set -euo pipefail
cd "$(dirname "$0")/.."
document=docs/PERFORMANCE.md

bench() { cargo bench --quiet --locked -p "$1" --bench "$2"; }
# A benchmark marks the rows of the table with "= ".
rows() { sed -n 's/^= //p' <<<"$1" | tail -n +2; }
details() { grep -v '^= ' <<<"$1" || true; }
has_goal() { awk -F'|' '$3 !~ /^ *$/'; }
has_no_goal() { awk -F'|' '$3 ~ /^ *$/'; }

cargo bench --quiet --locked --no-run -p ecan-protocol -p ecan-host -p ecan-mcan-port \
    -p ecan-cia402 -p ecan-igh-host --bench codec --bench wake_up --bench cycle --bench axes \
    --bench simulation --bench c_face
load_before=$(cut -d' ' -f1-2 /proc/loadavg)
codec=$(bench ecan-protocol codec)
cycle=$(bench ecan-mcan-port cycle)
axes=$(bench ecan-cia402 axes)
simulation=$(bench ecan-cia402 simulation)
c_face=$(bench ecan-igh-host c_face)

wake_up='| wake-up at 1 ms, p50 | 1.1 | not measured in this run | | cycle timer / cyclictest |
| wake-up at 1 ms, p99 | 1.2 | not measured in this run | | cycle timer / cyclictest |
| wake-up at 1 ms, p99, 100 us spin | 0.1 | not measured in this run | | cycle timer / cyclictest |'
wake_up_details=$(bench ecan-host wake_up)
measured=$(rows "$wake_up_details")
wake_up=${measured:-$wake_up}
wake_up_details=$(details "$wake_up_details")

# cycle "us" frames load "%" median ...
simulated=$(awk '$2 == "us" {
    frames = sprintf("%.0f", $3); goal = frames >= 38 ? "at least 500" : ""
    printf "| simulator, 10 axes, %s frames in a cycle of %s us | %s | %s%s | | simulated / wall-clock time |\n",
        frames, $1, goal, $6, goal != "" && $6 < 500 ? " (missed)" : ""
}' <<<"$simulation")

table="| measure | goal | accelerated | portable | what |
|---|---|---:|---:|---|
$(rows "$codec" | has_goal)
$(rows "$cycle")
$(rows "$axes")
$simulated
$wake_up
$(rows "$c_face")"
echo "$table"

remarks=$(sed -n '/^## Remarks/,$p' "$document" 2>/dev/null || true)
of_cpu() { lscpu | sed -n "s/^$1: *//p" | head -1; }

{
    cat <<TEXT
# Performance

Written by \`scripts/measure-performance.sh\` on $(date -u +%F).

| Machine | |
|---|---|
| CPU | $(of_cpu 'Model name'), family $(of_cpu 'CPU family'), model $(of_cpu 'Model') |
| Cores | $(nproc) |
| Last-level cache | $(of_cpu 'L3 cache' | sed 's/ (.*//') |
| Kernel | $(uname -sr) |
| rustc | $(rustc --version) |
| gcc | $(gcc --version | head -1) |
| Load average (1 and 5 minutes) before the run | $load_before |

Ratios only: smaller is better, except for the simulator. Two sides take turns in one process; each
round gives a ratio, and the figure is the median of 3001 of them (301 with cold caches). Accelerated
means CRC by carry-less multiplication (of two blocks at once where the processor can); portable, by
tables alone. Where both have a goal, the goal of
the portable kernel stands second.

$table

## Codec of process data

Time of this codec over that of a plain C codec (\`ecan-protocol/benches/baseline\`: CRC by a table of
256 entries, byte by byte; the image cleared whole; compiled with -O3). Both write the same bytes and
read the same packets. An image is written from frames made beforehand, then judged and read without
a copy, with a look at channel, identifier, length and first data byte of each frame.

$(details "$codec")

Before each cold call one byte of every cache line of a buffer is read. Twice as large as the
second-level cache, it leaves frames, image, tables and code in the last-level cache, as far as that has
room; twice as large as the last-level cache, it leaves them in memory, the first clock reading too.

Wire time is that of an RxPDO and a TxPDO image of N x 128 bytes each at 100 Mbit/s, 80 ns a byte:
\`bytes = 2 x 128 x N + 52 x frames\`, \`frames = ceil(2 x 128 x N / 1486)\`. The 52 bytes around the
data are preamble and start (8), Ethernet header (14), EtherCAT header (2), datagram header and working
counter (12), check sequence (4) and gap (12). The images are full of frames of 8 bytes; one is written,
one read.

CRC of short inputs, without a goal:

| measure | goal | accelerated | portable | what |
|---|---|---:|---:|---|
$(rows "$codec" | has_no_goal)

    cargo bench -p ecan-protocol --bench codec

## Whole cycle

\`cycle_begin\`, receive everything, send, \`cycle_end\` of a Port on a master that exchanges nothing
(\`benches/null-master\`): its functions only succeed, and give each TxPDO image its next sequence number.
The other side is the bare codec with the same images. What the Port does beyond the codec: sessions,
working counters, sequence of images, checks of channel and frame, tickets, statistics.

    cargo bench -p ecan-mcan-port --bench cycle

## CiA 402 axes

\`process_rx\` and \`send_targets_all\`, without begin and end of the cycle. A cycle in which every axis sent
its TPDO is played again and again; every axis follows targets at standstill. Four axes on a channel,
sixteen on a gateway: ten are on one gateway, forty on three.

$(details "$axes")

    cargo bench -p ecan-cia402 --bench axes

## Simulator

Simulated time over wall-clock time, in stepped time, host and bit-exact buses included.

\`\`\`text
$simulation
\`\`\`

    cargo bench -p ecan-cia402 --bench simulation

## Wake-up

How late the cycle starts at a period of 1 ms, segments of the cycle timer and of \`cyclictest\` in
turn; the figure is the median of the ratios of neighbours.

\`\`\`text
$wake_up_details
\`\`\`

    cargo bench -p ecan-host --bench wake_up

## C face

What a call through the C functions costs over the Rust call.

\`\`\`text
$(details "$c_face")
\`\`\`

    cargo bench -p ecan-igh-host --bench c_face
TEXT
    if [ -n "$remarks" ]; then
        printf '\n%s\n' "$remarks"
    fi
} >"$document.new"
mv "$document.new" "$document"
