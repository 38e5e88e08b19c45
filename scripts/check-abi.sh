#!/usr/bin/env bash
# Compares the binary interface of the C libraries with the stored one of the last release, or of the
# version in preparation: capi/abi. docs/VERSIONS.md says which differences are allowed. Needs gcc and
# abigail-tools.
#
#     scripts/check-abi.sh [--headers DIRECTORY]     reports the differences
#     scripts/check-abi.sh --update                  stores the present interface
#
# abidw reads the debug information of a small library in C with the functions of the headers. That of
# the Rust libraries describes Rust's types.
set -euo pipefail
cd "$(dirname "$0")/.."
mode=check
headers=include
while (($#)); do
    case "$1" in
    --update) mode=update ;;
    --headers) headers=$2 && shift ;;
    *) echo "usage: $0 [--update | --headers DIRECTORY]" >&2 && exit 2 ;;
    esac
    shift
done
version=$(sed -n 's/^version = "\([0-9]*\.[0-9]*\)\.[0-9]*"/\1/p' Cargo.toml | head -1)
# A version in preparation may differ from the one before; a released one only gets additions.
prepared=$(sed -n "s/^## \($version\.0\) (unreleased)/\1/p" CHANGELOG.md)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

{
    for header in "$headers"/*.h; do
        echo "#include <$(basename "$header")>"
    done
} >"$work/headers.c"

# The interface: types and functions, constants, and the functions of each library with their version.
gcc -std=c99 "-I$headers" -aux-info "$work/functions" -fsyntax-only "$work/headers.c"
{
    cat "$work/headers.c"
    sed -nE 's/^.*\*\/ extern (.*[ *](ecan|igh)_.*);$/\1 { __builtin_trap(); }/p' "$work/functions"
} >"$work/functions.c"
headers=$(realpath "$headers")
(cd "$work" && gcc -std=gnu2x -shared -nostdlib -fPIC -g -fno-eliminate-unused-debug-types \
    "-I$headers" functions.c -o ecan.so)
abidw --load-all-types --no-parameter-names --no-show-locs --no-corpus-path --no-comp-dir-path \
    --no-architecture --type-id-style hash "$work/ecan.so" >"$work/ecan.abi"
{
    gcc -E -dM "-I$headers" "$work/headers.c" |
        sed -nE 's/^#define ((ECAN|IGH)_[A-Z0-9_]+) (-?[0-9].*)/\1 \3/p' | grep -vE '^ECAN_VERSION'
    # abidiff takes an additional value of an enumeration for no difference.
    sed -nE 's/^ +((ECAN|IGH)_[A-Z0-9_]+) = (-?[0-9]+),?$/\1 \3/p' "$headers"/*.h
} | LC_ALL=C sort >"$work/constants"
for map in capi/libecan_*.map; do
    awk -v library="$(basename "$map" .map)" '/^ECAN/ { node = $1 }
        /^ +(ecan|igh)_/ { sub(";", ""); print library, node, $1 }' "$map"
done | grep -v ' ECAN_PRIVATE_' | LC_ALL=C sort >"$work/symbols"

# Reports the differences to a stored interface: sets `differs`, and `removed` if an old application
# would miss something.
differs=0
removed=0
compare() {
    local list status=0
    for list in constants symbols; do
        if ! diff -U0 "$1/$list" "$work/$list" >"$work/diff"; then
            echo "$list:"
            grep -E '^[+-][^+-]' "$work/diff"
            differs=1
            if grep -qE '^-[^-]' "$work/diff"; then removed=1; fi
        fi
    done
    # Bits of the status: 1 and 2 errors, 4 changes, 8 changes that break applications.
    abidiff --non-reachable-types "$1/ecan.abi" "$work/ecan.abi" >"$work/report" || status=$?
    if ((status & 3)); then
        cat "$work/report"
        exit 1
    fi
    if ((status & 12)); then
        cat "$work/report"
        differs=1
    fi
    if ((status & 8)); then removed=1; fi
}

stored=$(find capi/abi -mindepth 1 -maxdepth 1 -type d | sort -V | tail -1)
if [ -n "$stored" ]; then compare "$stored"; fi
if ((removed)) && [ "$stored" = "capi/abi/$version" ] && [ -z "$prepared" ]; then
    echo "version $version is released; these changes need a new minor version: docs/VERSIONS.md" >&2
    exit 1
fi
if [ "$mode" = update ]; then
    mkdir -p "capi/abi/$version"
    cp "$work/ecan.abi" "$work/constants" "$work/symbols" "capi/abi/$version"
    echo "capi/abi/$version written"
elif ((differs)); then
    echo "compare these changes with docs/VERSIONS.md, then run scripts/check-abi.sh --update" >&2
    exit 1
else
    echo "the interface is that of $stored"
fi
