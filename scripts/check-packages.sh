#!/usr/bin/env bash
# Packs every crate that applications import, as `cargo publish` would.
#
#     scripts/check-packages.sh [--list]      --list: only prints them, in the order of publication
set -euo pipefail
cd "$(dirname "$0")/.."
crates=(ecan-protocol ecrt-sys ecan-host ecan-mcan-port ecan-canopen ecan-cia402
    ecan-can-io ecan-service
    ecan-service-zenoh ecan-sim ecan-lite)
if [ "${1-}" = --list ]; then
    printf '%s\n' "${crates[@]}"
    exit
fi
# Without compiling them again: the workspace is compiled by the other stages.
cargo package --quiet --no-verify --allow-dirty --locked "${crates[@]/#/--package=}"
echo "packed ${#crates[@]} crates"
