#!/bin/sh
# Writes ecrt-sys/src/bindings.rs anew from ecrt-sys/ecrt-abi.h.
# With --check nothing is written; the exit status tells whether the file is up to date.
# Needs libclang (Debian: libclang-dev).
set -eu

check=no
case "${1-}" in
    '') ;;
    --check) check=yes ;;
    *) echo "usage: $0 [--check]" >&2; exit 2 ;;
esac

root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
cd "$root"
unset ECRT_INCLUDE_DIR
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# A target directory of its own holds exactly one OUT_DIR.
cargo build --quiet --locked --package ecrt-sys --features regenerate --target-dir "$work"
generated=$(find "$work" -path '*/out/bindings.rs' -path '*ecrt-sys-*')
if [ -z "$generated" ]; then
    echo "the build left no bindings.rs" >&2
    exit 1
fi

checked_in=ecrt-sys/src/bindings.rs
if [ "$check" = yes ]; then
    if ! diff -u "$checked_in" "$generated"; then
        echo "$checked_in is not what ecrt-abi.h gives: run scripts/regenerate-bindings.sh" >&2
        exit 1
    fi
else
    cp "$generated" "$checked_in"
fi
