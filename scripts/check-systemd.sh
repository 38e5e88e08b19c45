#!/usr/bin/env bash
# Checks the systemd units, without the program that they start.
set -euo pipefail
cd "$(dirname "$0")/.."
directory=$(mktemp -d)
trap 'rm -r "$directory"' EXIT
for unit in {tools/ecan/systemd,examples/zenoh}/*.service tools/ecan/systemd/*.socket; do
    sed 's#/usr/local/bin/ecan#/bin/true#' "$unit" >"$directory/$(basename "$unit")"
done
mkdir "$directory/ecan-serve@.service.d"
cp tools/ecan/systemd/*.conf "$directory/ecan-serve@.service.d"
problems=$(systemd-analyze verify "$directory"/*.service "$directory"/*.socket 2>&1) || true
if [[ -n $problems ]]; then
    printf '%s\n' "$problems"
    exit 1
fi
echo "the systemd units have no problems"
