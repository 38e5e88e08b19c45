#!/usr/bin/env bash
# Checks that the files and the tests that the documents name exist.
set -euo pipefail
cd "$(dirname "$0")/.."

documents=(README.md CONTRIBUTING.md API.md docs/*.md docs/guide/*.md)
sources=$(mktemp)
trap 'rm -f "$sources"' EXIT
git grep -ohE '\bfn [a-z0-9_]+' -- '*.rs' | sed 's/^fn //' | sort -u >"$sources"
missing=0

report() {
    echo "$1: $2 does not exist"
    missing=1
}

# Everything in backquotes, one per line.
# shellcheck disable=SC2016 # the backquotes are text
quoted() { grep -oE '`[^`]+`' "$1" | tr -d '`' | sort -u; }

for document in "${documents[@]}"; do
    [ -e "$document" ] || continue
    while read -r name; do
        case "$name" in
        *' '* | *'<'* | *'*'* | /* | -* | *'$'*) ;;
        # A test: `file::function`, or the beginning of its name: `function_..`.
        [a-z]*::*_*_*)
            function=${name##*::}
            if [[ $function =~ ^[a-z0-9_]+$ ]] && ! grep -qx "$function" "$sources"; then
                report "$document" "$name"
            fi
            ;;
        *_..)
            grep -q "^${name%..}" "$sources" || report "$document" "$name"
            ;;
        *.rs | *.sh | *.md | */*.toml | *.c | *.lua)
            case "$name" in */*) ;; *) continue ;; esac
            [ -e "$name" ] || [ -e "ecan-sim/src/$name" ] || [ -e "docs/$name" ] ||
                report "$document" "$name"
            ;;
        esac
    done < <(quoted "$document")
    # Links to files of the project.
    while read -r link; do
        [ -e "$(dirname "$document")/$link" ] || report "$document" "link $link"
    done < <(grep -oE '\]\([^)#:]+[)#]' "$document" | sed -e 's/^](//' -e 's/.$//' | sort -u)
done
if ((missing)); then
    exit 1
fi
echo "all files and tests that the documents name exist"
