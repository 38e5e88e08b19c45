#!/usr/bin/env bash
# Runs a fuzz target for some seconds (60): scripts/fuzz.sh TARGET [SECONDS] [options of libFuzzer].
# Without a target it names those there are. Needs a C++ compiler; the toolchain is the stable one.
set -euo pipefail
cd "$(dirname "$0")/.."

if (($# == 0)); then
    echo "targets: $(basename -s .rs checks/fuzz/targets/*.rs | tr '\n' ' ')"
    exit 2
fi
target=$1
seconds=${2:-60}
shift $(($# > 1 ? 2 : 1))
if [[ ! -f checks/fuzz/targets/$target.rs ]]; then
    echo "fuzz.sh: there is no target \"$target\"; run it without arguments to see which" >&2
    exit 2
fi
# Coverage counters for libFuzzer, as its manual lists them.
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
coverage+=" -Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
coverage+=" -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares"
host=$(rustc -vV | sed -n 's/^host: //p')
# With a target named, build scripts and macros go without the counters.
RUSTFLAGS=$coverage CARGO_TARGET_DIR=target/fuzz \
    CARGO_PROFILE_RELEASE_OVERFLOW_CHECKS=true CARGO_PROFILE_RELEASE_DEBUG_ASSERTIONS=true \
    cargo build --quiet --release --locked --manifest-path checks/Cargo.toml -p ecan-fuzz --features link \
    --target "$host" --bin "$target"
mkdir -p "target/fuzz/corpus/$target" "target/fuzz/findings"
# What a target begins with, where it would not find the grammar by itself.
tar --extract --xz --file checks/fuzz/seeds.tar.xz --directory target/fuzz
seeds=()
if [[ -d target/fuzz/seeds/$target ]]; then seeds=("target/fuzz/seeds/$target"); fi
# Words of the grammar.
words=()
if [[ -f checks/fuzz/words/$target.dict ]]; then words=("-dict=checks/fuzz/words/$target.dict"); fi
exec "target/fuzz/$host/release/$target" "-max_total_time=$seconds" -max_len=8192 \
    -artifact_prefix=target/fuzz/findings/ "${words[@]}" "$@" "target/fuzz/corpus/$target" "${seeds[@]}"
