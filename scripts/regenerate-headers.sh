#!/usr/bin/env bash
# Generates from the sources of capi/: the C headers and the codes of the C++ header in include/, the version
# scripts of the libraries, and the calls with NULL of the test every_function. With --check it only reports
# stale files.
set -euo pipefail
cd "$(dirname "$0")/.."
exec cargo run --quiet --locked --manifest-path checks/Cargo.toml --target-dir target -p ecan-headers -- "$@"
