#!/usr/bin/env bash
# Runs the tests of the protocol on 64-bit ARM, emulated by qemu, with the accelerated CRC.
# Needs gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user-static.
#
#     scripts/check-arm64.sh
set -euo pipefail
cd "$(dirname "$0")/.."
target=aarch64-unknown-linux-gnu
run=(qemu-aarch64-static -L /usr/aarch64-linux-gnu)
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="${run[*]}"
# Bounds the time of the property tests under the emulation.
export PROPTEST_CASES=${PROPTEST_CASES:-16}
export PROPTEST_DISABLE_FAILURE_PERSISTENCE=1
rustup target add "$target" >/dev/null 2>&1 || {
    echo "check-arm64: rustup cannot add the target $target" >&2
    exit 1
}

output=$(mktemp)
trap 'rm "$output"' EXIT
cargo test --quiet --locked --target "$target" -p ecan-protocol --lib --tests -- --nocapture |
    tee "$output" | grep -E '^test result'
# Of the test of the CRC: the accelerated kernel must have run.
if grep -F "only the table kernel is tested" "$output"; then
    echo "check-arm64: the emulated processor has no PMULL; install qemu 7.2 or later" >&2
    exit 1
fi
