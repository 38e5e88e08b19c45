#!/usr/bin/env bash
# Runs tests of the protocol, with the accelerated CRC, of the Port and of the C interface on 64-bit ARM,
# emulated by qemu. Needs gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user-static.
#
#     scripts/check-arm64.sh           a sample of those of the Port and of the C interface
#     scripts/check-arm64.sh --all     all of them: two minutes more
set -euo pipefail
cd "$(dirname "$0")/.."
case ${1-} in
'' | --all) ;;
*)
    echo "check-arm64: unknown argument \"$1\"; allowed: --all" >&2
    exit 2
    ;;
esac
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
# With the same packages in each call, so that each is compiled once.
tests() { # ARGUMENTS...
    cargo test --quiet --locked --target "$target" -p ecan-protocol -p ecan-mcan-port -p ecan-igh-host "$@" \
        2> >(grep -v ^SIMULATED >&2) | tee "$output" | grep -E '^test result|FAILED|panicked'
}

# The emulator has no robust mutexes, and does not filter system calls (Port, no_system_calls).
tests --lib --test protocol -- --nocapture --skip handle::tests::cycle_ends_with_its_thread \
    --skip handle::tests::open_cycle_belongs_to_its_thread
# Of the test of the CRC: the accelerated kernel must have run.
if grep -F "only the table kernel is tested" "$output"; then
    echo "check-arm64: the emulated processor has no PMULL; install qemu 7.2 or later" >&2
    exit 1
fi
if [[ ${1-} ]]; then
    tests --test port --test allocation --test corrupted_config --test node_allocation --test standard_error
else
    tests --test port -- exchange:: startup::
fi
