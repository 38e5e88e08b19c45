#!/usr/bin/env bash
# Makes the C headers in include/ anew. With --check it only says what is stale, which exported
# function is not announced in a version script, and which API.md does not name.
set -euo pipefail
cd "$(dirname "$0")/.."
exec cargo run --quiet --locked -p ecan-headers -- "$@"
