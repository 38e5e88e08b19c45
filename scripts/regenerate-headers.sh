#!/usr/bin/env bash
# Generates the C headers in include/. With --check it only reports stale files and exported functions
# that a version script does not list.
set -euo pipefail
cd "$(dirname "$0")/.."
exec cargo run --quiet --locked --manifest-path checks/Cargo.toml --target-dir target -p ecan-headers -- "$@"
