#!/usr/bin/env bash
# Runs the benchmarks and writes their tables, with machine and date, into docs/PERFORMANCE.md. What
# that file says from "## Remarks" on is kept: it is written by hand. Other load on the machine
# spoils the figures.
#
#     scripts/measure-performance.sh
set -euo pipefail
cd "$(dirname "$0")/.."
document=docs/PERFORMANCE.md

codec=$(cargo bench --quiet -p ecan-protocol --bench codec)
c_face=$(cargo bench --quiet -p ecan-igh-host --bench c_face)
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
| Load average before the last measure | $(cut -d' ' -f1 /proc/loadavg) |

## Codec of process data

Time of this codec over that of a plain C codec (\`ecan-protocol/benches/baseline\`: CRC by a table of
256 entries, byte by byte; the image cleared whole; compiled with -O3). Both write the same bytes and
read the same packets. They run in turn in one process; the ratio is that of the medians of 3001 warm
or 301 cold rounds. An image is written from frames made beforehand, then judged and read without a
copy, with a look at channel, identifier, length and first data byte of each frame. Accelerated means
CRC by carry-less multiplication; portable, by tables alone.

$codec

Before each cold call one byte of every cache line of a buffer of twice the last-level cache is read.
Frames, image, tables and code then come from memory, and the first clock reading too.

Wire time is that of an RxPDO and a TxPDO image of N x 128 bytes each at 100 Mbit/s, 80 ns a byte:
\`bytes = 2 x 128 x N + 52 x frames\`, \`frames = ceil(2 x 128 x N / 1486)\`. The 52 bytes around the
data are preamble and start (8), Ethernet header (14), EtherCAT header (2), datagram header and working
counter (12), check sequence (4) and gap (12). The images are full of frames of 8 bytes; one is written,
one read.

    cargo bench -p ecan-protocol --bench codec

## C face

What a call through the C functions costs over the Rust call.

\`\`\`text
$c_face
\`\`\`

    cargo bench -p ecan-igh-host --bench c_face
TEXT
    if [ -n "$remarks" ]; then
        printf '\n%s\n' "$remarks"
    fi
} >"$document.new"
mv "$document.new" "$document"
