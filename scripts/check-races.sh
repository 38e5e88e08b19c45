#!/usr/bin/env bash
# Runs the C programs with threads under ThreadSanitizer, with the Rust library and its standard library instrumented,
# too. Needs gcc and setarch; installs the sources of the standard library (rustup).
set -euo pipefail
cd "$(dirname "$0")/.."
rustup component add --quiet rust-src 2>/dev/null || rustup component add rust-src
unset RUSTC_WORKSPACE_WRAPPER
target=${CARGO_TARGET_DIR:-$PWD/target}/races triple=$(rustc -vV | sed -n 's/^host: //p')
# The options are not stable in this compiler.
RUSTC_BOOTSTRAP=1 RUSTFLAGS="-Zsanitizer=thread" cargo build --quiet --locked -Zbuild-std --target "$triple" \
    --target-dir "$target" -p ecan-igh-host -p ecan-mcan-host --features ecan-igh-host/sim

libraries=$target/$triple/debug
runtime=$(rustc --print sysroot)/lib/rustlib/$triple/lib/librustc-stable_rt.tsan.a
build() { # NAME SOURCES...
    local objects=$target/$1-objects
    rm -rf "$objects" && mkdir -p "$objects"
    (cd "$objects" && gcc -g -fsanitize=thread -I"$OLDPWD/include" -I"$OLDPWD/capi/tests" -c "${@:2}")
    # Both libraries hold the standard library.
    gcc "$objects"/*.o -Wl,--whole-archive "$runtime" -Wl,--no-whole-archive -Wl,--allow-multiple-definition \
        -Wl,--start-group "$libraries/libecan_igh_host.a" "$libraries/libecan_mcan_host.a" -Wl,--end-group \
        -pthread -ldl -lm -lrt -lgcc_s -o "$target/$1"
}
build observer_stress "$PWD/capi/tests/observer_stress.c"
build every_function "$PWD"/capi/tests/every_function/*.c
# The sanitizer does not run at every address.
setarch -R "$target/observer_stress" 1000000
setarch -R "$target/every_function"
