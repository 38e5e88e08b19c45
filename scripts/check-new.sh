#!/usr/bin/env bash
# Builds, runs and tests projects of `ecan new` in an empty folder.
#
#     scripts/check-new.sh frames|axes rust              with this source tree
#     scripts/check-new.sh frames|axes c|cpp INSTALLED   with an installed tree
set -euo pipefail
cd "$(dirname "$0")/.."

purpose=$1 lang=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo run --quiet --locked -p ecan-tool -- new "$work/hello" --lang "$lang" --for "$purpose" | sed 1d
if [ "$lang" = rust ]; then
    # The versions of this tree, and its crates of others.
    cp Cargo.lock "$work/hello"
    export CARGO_TARGET_DIR=$PWD/target
    unset RUSTC_WORKSPACE_WRAPPER
    cd "$work/hello"
    ECAN_ECRT=sim cargo run --quiet | tail -1
    cargo test --quiet
else
    installed=$(cd "$3" && pwd)
    cd "$work/hello"
    cmake -S . -B build -DCMAKE_PREFIX_PATH="$installed" >build.log || { cat build.log; exit 1; }
    cmake --build build >build.log || { cat build.log; exit 1; }
    ECAN_ECRT=sim build/hello | tail -1
    ctest --test-dir build --output-on-failure >build.log || { cat build.log; exit 1; }
fi
