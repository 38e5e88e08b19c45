#!/bin/sh
# Fails if an exported function is not called by this test outside the generated calls with NULL, except those
# between the libraries.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
missing=0
for name in $(sed -n 's/^ *\([a-z][a-z0-9_]*\);$/\1/p' "$here"/../../libecan_*.map |
    grep -v "^ecan_private_" | sort -u); do
    if ! grep -Eq --exclude=null_pointers.c "(^|[^a-z0-9_])$name *\(" "$here"/*.c; then
        echo "not called: $name" >&2
        missing=$((missing + 1))
    fi
done
if [ "$missing" -gt 0 ]; then
    echo "$missing functions are missing" >&2
    exit 1
fi
echo "every exported function is called"
