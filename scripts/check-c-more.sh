#!/usr/bin/env bash
# The part of the C side that takes long, after scripts/check-c.sh with the same directory: builds with other options, the
# C++ header by every compiler, and all programs under AddressSanitizer, UndefinedBehaviorSanitizer and valgrind. Needs
# cmake, gcc, g++, clang and valgrind.
#
#     scripts/check-c-more.sh [BUILD_DIRECTORY]
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:-build}
mkdir -p "$build"
build=$(cd "$build" && pwd)
target=${CARGO_TARGET_DIR:-$PWD/target}

say() { printf -- '-- %s\n' "$1"; }

# Tests of ctest that run no program of a checker's build.
without_programs='old_application|symbols_of|dependency_of'
# Runs the programs of a build; a report of a checker is an error for every exit status.
# Arguments: name of the checker, build, arguments of ctest.
run_checked() {
    local reports=$build/$1
    ctest --test-dir "$2" --output-on-failure --parallel 2 "${@:3}" >"$build/$1.log" ||
        { tail -n 40 "$build/$1.log"; exit 1; }
    tail -n 4 "$build/$1.log" | head -n 2
    if find "$reports" -type f -size +0 -exec cat {} + | grep -m 60 .; then
        echo "reports of $1: $reports" >&2
        exit 1
    fi
}

say "all programs, under AddressSanitizer and UndefinedBehaviorSanitizer"
sanitizer="-g -fsanitize=address,undefined -fno-sanitize-recover=undefined"
rm -rf "$build/asan" && mkdir "$build/asan"
cmake -S . -B "$build/sanitized" -DECAN_CARGO_TARGET_DIR="$target" \
    "-DCMAKE_C_FLAGS=$sanitizer" >"$build/sanitized.log"
cmake --build "$build/sanitized" --parallel 2 >>"$build/sanitized.log" ||
    { tail -n 40 "$build/sanitized.log"; exit 1; }
ASAN_OPTIONS=detect_leaks=1:log_path=$build/asan/address UBSAN_OPTIONS=log_path=$build/asan/undefined \
    run_checked asan "$build/sanitized" --exclude-regex "$without_programs"

# Each program once. Those of which two share a bus in real time are too slow for it.
say "all programs, under valgrind"
again='_static$|_whole$|_plan|_faulty|_excludes|_shift|_large_pdos|_real_time'
real_time='attached_master$|attached_master_by_name'
rm -rf "$build/valgrind" && mkdir "$build/valgrind"
# Ten million calls would take it half an hour.
memcheck="valgrind --quiet --error-exitcode=99 --leak-check=full --show-leak-kinds=definite,indirect
    --errors-for-leak-kinds=definite,indirect --fair-sched=yes --log-file=$build/valgrind/%p"
# shellcheck disable=SC2086 # words
$memcheck "$build/capi/tests/observer_stress" 20000
ECAN_TEST_RUNNER=$memcheck run_checked valgrind "$build" \
    --exclude-regex "$without_programs|observer_stress|$again|$real_time"

say "the C++ header and its programs"
rm -rf "$build/installed-again"
cmake --install "$build" --prefix "$build/installed-again" >"$build/install.log"
scripts/check-cpp.sh --all "$build/installed-again" "$build/cpp"

say "without the simulator"
cmake -S . -B "$build/plain" -DECAN_IGH_SIM=OFF -DECAN_CARGO_TARGET_DIR="$target" \
    >"$build/plain.log"
cmake --build "$build/plain" --parallel 2
ctest --test-dir "$build/plain" --output-on-failure

say "the protocol alone"
cmake -S . -B "$build/protocol" -DECAN_IGH_BUILD_DEMO=OFF -DECAN_CARGO_TARGET_DIR="$target" \
    >"$build/protocol.log"
cmake --build "$build/protocol"
test ! -e "$build/protocol/libecan_igh_host.a"
