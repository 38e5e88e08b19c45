#!/usr/bin/env bash
# Writes the table of the licences of all dependencies in docs/guide/licences.md: what the C libraries
# and the programs link. From `cargo tree`, so without a further tool.
#
#     scripts/regenerate-licenses.sh            writes the table
#     scripts/regenerate-licenses.sh --check    fails if the table is not up to date
set -euo pipefail
cd "$(dirname "$0")/.."
page=docs/guide/licences.md
packages=(ecan-igh-host ecan-mcan-host ecan-sim-ethercat ecan-tool ecan-sim-program ecan-lite)

# Arguments: format. One line per crate of another author that the packages link.
crates() {
    cargo tree --locked --edges normal --prefix none --format "$1" --target x86_64-unknown-linux-gnu \
        "${packages[@]/#/--package=}" | grep '.' | grep -v '(/' | sed -e 's/ (\*)$//' -e 's/ (proc-macro)$//' | sort --unique
}

# One line per licence: its crates of other authors. Versions are in the SBOM.
table() {
    echo '| licence | crates |'
    echo '| --- | --- |'
    crates '{l}|{p}' | sed -e 's# */ *# OR #' -e 's/ v[0-9].*//' | sort --unique | awk -F '|' '
            $1 != licence { if (licence != "") print "| " licence " | " crates " |"; licence = $1; crates = $2; next }
            { crates = crates ", " $2 }
            END { print "| " licence " | " crates " |" }'
}

new=$(mktemp)
trap 'rm -f "$new"' EXIT
table >"$new.table"
awk -v table="$new.table" '
    /^<!-- end of the table -->$/ { inside = 0 }
    !inside
    /^<!-- table: scripts\/regenerate-licenses.sh -->$/ { inside = 1; while ((getline line < table) > 0) print line }' "$page" >"$new"
rm -f "$new.table"
if [ "${1-}" = --check ]; then
    diff -u "$page" "$new" || { echo "$page is not up to date; run scripts/regenerate-licenses.sh" >&2; exit 1; }
else
    cat "$new" >"$page"
fi
