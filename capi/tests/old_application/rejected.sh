#!/bin/sh
# An application that was built for 0.1 runs with 0.1, and the loader rejects it with the libraries of
# DIRECTORY, under their own names and under the name of 0.1. It rejects two libraries of different
# versions as well.
#
#     rejected.sh CC DIRECTORY WORK
set -eu
here=$(cd "$(dirname "$0")" && pwd)
cc=$1
libraries=$2
work=$3
rm -rf "$work"
mkdir -p "$work/old" "$work/renamed"
old=libecan_igh_host.so.0.1
"$cc" -shared -fPIC -Wl,-soname,$old "-Wl,--version-script=$here/library.map" "$here/library.c" \
    -o "$work/old/$old"
"$cc" "$here/application.c" "$work/old/$old" -o "$work/application"

LD_LIBRARY_PATH=$work/old "$work/application"

# The loader ends the program before main, with this in its message.
rejected() {
    directory=$1
    shift
    if LD_LIBRARY_PATH=$directory LC_ALL=C "$application" 2>"$work/message"; then
        echo "the application runs with the libraries of $directory" >&2
        exit 1
    fi
    cat "$work/message"
    if ! grep -qF "$1" "$work/message"; then
        echo "expected: $1" >&2
        exit 1
    fi
}
application=$work/application
rejected "$libraries" "error while loading shared libraries: $old: cannot open shared object file"
for library in "$libraries"/libecan_*.so.*; do
    ln -s "$library" "$work/renamed/"
done
ln -s "$libraries/libecan_igh_host.so" "$work/renamed/$old"
rejected "$work/renamed" "version \`ECAN_0.1' not found (required by $work/application)"

# libecan_igh_host of this version with libecan_mcan_host of another patch level.
map=$here/../../libecan_mcan_host.map
node=$(sed -n 's/^\(ECAN_[0-9.]*\) {/\1/p' "$map")
private=$(sed -n 's/^\(ECAN_PRIVATE_[0-9.]*\) {/\1/p' "$map")
soname=libecan_mcan_host.so.${node#ECAN_}
sed "s/ECAN_0.1/$node/" "$here/library.map" >"$work/mixed.map"
echo "${private}9 { };" >>"$work/mixed.map"
mkdir "$work/mixed"
"$cc" -shared -fPIC "-Wl,-soname,$soname" "-Wl,--version-script=$work/mixed.map" "$here/library.c" \
    -o "$work/mixed/$soname"
ln -s "$libraries"/libecan_igh_host.so.* "$work/mixed/"
application=$work/mixed_application
"$cc" "$here/application.c" -Wl,--no-as-needed "$libraries/libecan_igh_host.so" \
    "$libraries/libecan_mcan_host.so" -o "$application"
LD_LIBRARY_PATH=$libraries "$application"
rejected "$work/mixed" "version \`$private' not found (required by "
