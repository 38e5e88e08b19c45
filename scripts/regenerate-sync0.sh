#!/bin/sh
# Writes the table of Sync0 shifts in docs/PERFORMANCE.md: stable points of the manual, usable shifts of the simulator and of the
# plan. With --check nothing is written; the exit status shows whether the table is up to date.
set -eu
cd "$(dirname "$0")/.."

case "${1-}" in
    '') export WRITE_SYNC0_TABLE=1 ;;
    --check) unset WRITE_SYNC0_TABLE ;;
    *) echo "usage: $0 [--check]" >&2; exit 2 ;;
esac
exec cargo test --quiet --locked -p ecan-examples --test examples stable_points
