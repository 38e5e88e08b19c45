#!/bin/sh
# Mutation score of `ecan probe`: which assumptions about the device its experiments decide, and which
# alternatives of the simulated gateway they name.
set -eu
cd "$(dirname "$0")/.."
output=$(cargo test --quiet --locked -p ecan-tool-support --test support -- score --nocapture --test-threads=1) || {
    echo "$output"
    exit 1
}
echo "$output" | sed -e 's/^\.*//' -e '/^running/d' -e '/^test /d' -e '/^$/d'
