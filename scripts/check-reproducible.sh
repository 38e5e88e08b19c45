#!/usr/bin/env bash
# Builds the C libraries twice, from copies of the tree in two directories, and compares every file.
#
#     scripts/check-reproducible.sh [--quick] [--output DIR]
#
# --quick       only libecan_mcan_host, which takes seconds
# --output DIR  installs the files of the first build below DIR
#
# Needs cmake and a C compiler. The result depends on the source, the versions of Rust (rust-toolchain.toml),
# of the C compiler and of its binutils.
set -euo pipefail
cd "$(dirname "$0")/.."

options=(-DBUILD_TESTING=OFF)
output=
while (($#)); do
    case $1 in
    --quick) options+=(-DECAN_IGH_BUILD_DEMO=OFF) ;;
    --output)
        output=${2:?--output needs a directory}
        shift
        ;;
    *)
        echo "check-reproducible: unknown option \"$1\"; allowed: --quick, --output DIR" >&2
        exit 2
        ;;
    esac
    shift
done

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Both builds are of the same files, also if the tree changes in between.
git ls-files -z | tar --create --null --files-from=- --file="$work/source.tar"

# Arguments: directory of the copy, further options of `cmake --build`.
build() {
    local copy=$work/$1
    mkdir -p "$copy"
    tar --extract --directory "$copy" --file "$work/source.tar"
    (
        cd "$copy"
        unset CARGO_TARGET_DIR
        cmake -S . -B build -DCMAKE_INSTALL_PREFIX=/usr "${options[@]}"
        cmake --build build "${@:2}"
        DESTDIR=$work/installed-$1 cmake --install build
    ) >"$work/$1.log" 2>&1 || { tail -n 40 "$work/$1.log" >&2; exit 1; }
    (cd "$work/installed-$1" && find . -type f -exec sha256sum {} + | sort -k 2) >"$work/$1.sums"
}

# The builds differ in path, its length, language, time zone and the number of jobs.
LC_ALL=C TZ=UTC build a
LC_ALL=C.UTF-8 TZ=Asia/Tokyo build another-directory --parallel 2

if ! diff "$work/a.sums" "$work/another-directory.sums"; then
    echo "check-reproducible: the files above differ between two builds of the same tree;" \
        "compare them with diffoscope" >&2
    exit 1
fi
if [ -n "$output" ]; then
    mkdir -p "$output"
    cp -a "$work/installed-a/." "$output"
fi
grep -E '/lib[a-z_]+\.(a|so[.0-9]*)$' "$work/a.sums"
echo "two builds are equal: $(wc -l <"$work/a.sums") files"
