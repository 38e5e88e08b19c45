#!/usr/bin/env bash
# Runs the unsafe code under Miri and AddressSanitizer: scripts/check-undefined-behaviour.sh [miri] [asan].
# By hand, it takes many minutes. Needs a nightly toolchain; Miri also its components miri and rust-src.
# scripts/check-c-more.sh runs the C programs under valgrind and the sanitizers of C.
set -euo pipefail
cd "$(dirname "$0")/.."
export CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=0 PROPTEST_DISABLE_FAILURE_PERSISTENCE=1
host=$(rustc -vV | sed -n 's/^host: //p')

# Tests that Miri runs need no foreign function. The CRC kernel is chosen at compile time, since Miri has no cpuid.
# Skipped are tests of very many values, and those of ecan-igh-host that need the simulated library or read TOML.
# Miri has no robust mutex: two tests of handle.rs are ignored there.
run_miri() {
    export CARGO_TARGET_DIR=target/miri MIRIFLAGS="-Zmiri-disable-isolation" PROPTEST_CASES=2
    RUSTFLAGS="-Ctarget-feature=+pclmulqdq,+ssse3" \
        cargo +nightly miri test --locked -p ecan-protocol --lib --test protocol -- \
        --skip codec_baseline --skip bit_timing --skip status_word_round_trip --skip crc_changes_with_every_bit
    cargo +nightly miri test --locked -p ecan-c-boundary --lib
    cargo +nightly miri test --locked -p ecrt-sys --lib -- \
        --skip text_is_that_of_the_system --skip sim_without_simulator
    cargo +nightly miri test --locked -p ecan-igh-host --lib -- \
        --skip cia402::tests --skip canopen::tests --skip config_file::tests::file_
}

# Skipped is a test with a filter of system calls: the sanitizer makes some.
run_asan() {
    export CARGO_TARGET_DIR=target/asan ASAN_OPTIONS=detect_leaks=0 PROPTEST_CASES=16
    RUSTFLAGS="-Zsanitizer=address" \
        cargo +nightly test --locked --no-fail-fast --target "$host" --lib --tests \
        -p ecan-protocol -p ecrt-sys -p ecan-host -p ecan-mcan-port \
        -p ecan-c-boundary -p ecan-mcan-host -p ecan-igh-host \
        -- --skip cycle_makes_none
}

(($# > 0)) || set -- miri asan
for check in "$@"; do
    case $check in
        miri) run_miri ;;
        asan) run_asan ;;
        *)
            echo "check-undefined-behaviour.sh: unknown check \"$check\"; allowed: miri, asan" >&2
            exit 2
            ;;
    esac
done
