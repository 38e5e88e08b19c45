#!/usr/bin/env bash
# Writes the table of the licences of all dependencies in docs/guide/licences.md: what the C libraries
# and the programs link. From `cargo tree`, so without a further tool.
#
#     scripts/licences.sh            writes the table
#     scripts/licences.sh --check    fails if the table is not up to date
#     scripts/licences.sh --texts    prints the licence texts, as packages must contain them
set -euo pipefail
cd "$(dirname "$0")/.."
page=docs/guide/licences.md
packages=(ecan-igh-host ecan-mcan-host ecan-sim-ethercat ecan-tool ecan-sim-program ecan-lite)

# Arguments: format. One line per crate of another author that the packages link.
crates() {
    cargo tree --locked --edges normal --prefix none --format "$1" --target x86_64-unknown-linux-gnu \
        "${packages[@]/#/--package=}" | grep '.' | grep -v '(/' | sed -e 's/ (\*)$//' -e 's/ (proc-macro)$//' | sort --unique
}

# The texts come from the sources of the crates, as cargo has unpacked them.
texts() {
    cargo fetch --quiet --locked
    local line name version directory file found missing=()
    while read -r line; do
        name=${line%% *}
        version=${line##* v}
        directory=$(echo "${CARGO_HOME:-$HOME/.cargo}"/registry/src/*/"$name-$version")
        printf '\n%s\n%s %s\n' "$(printf '=%.0s' {1..80})" "$name" "$version"
        found=
        for file in "$directory"/{LICEN[CS]E,COPYING,COPYRIGHT,NOTICE,UNLICENSE}*; do
            [ -f "$file" ] || continue
            printf '\n---- %s\n\n' "${file##*/}"
            cat "$file"
            found=yes
        done
        [ -n "$found" ] || missing+=("$name $version")
    done < <(crates '{p}')
    # These crates name their licence in Cargo.toml only; its standard text is in this repository or above.
    ((${#missing[@]} == 0)) || printf 'licences: no text in the sources of: %s\n' "${missing[*]}" >&2
}

if [ "${1-}" = --texts ]; then
    texts
    exit
fi

# One line per licence: its crates of other authors. Versions are in the SBOM.
table() {
    echo '| licence | crates |'
    echo '| --- | --- |'
    crates '{l}|{p}' | sed -e 's#/# OR #' -e 's/ v[0-9].*//' | sort --unique | awk -F '|' '
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
    /^<!-- table: scripts\/licences.sh -->$/ { inside = 1; while ((getline line < table) > 0) print line }' "$page" >"$new"
rm -f "$new.table"
if [ "${1-}" = --check ]; then
    diff -u "$page" "$new" || { echo "licences: $page is not up to date; run scripts/licences.sh" >&2; exit 1; }
else
    cat "$new" >"$page"
fi
