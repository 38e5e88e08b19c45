#!/usr/bin/env bash
# Searches for words that docs/STYLE.md replaces by standard terms: in the lines added since BASE, and
# by count in the whole tree. Fails when added lines contain one of the words that are never right.
#
#     scripts/check-style.sh [BASE]      default: the branch point from origin/main, else the last commit
#     scripts/check-style.sh --update    prints the list with the present counts
set -euo pipefail
cd "$(dirname "$0")/.."

files=('*.rs' '*.md' '*.c' '*.h' '*.hpp' '*.cpp' '*.toml' '*.sh')
excluded=(':!include' ':!*STYLE.md' ':!scripts/check-style.sh' ':!CHANGELOG.md')
never='\b(amiss|mend(s|ed|ing)?|says? so|so many|unless told|in(to)? (and out of )?service|speaks? against)\b|\|it\|'

base=${1:-}
if [ -z "$base" ]; then
    base=$(git merge-base HEAD origin/main 2>/dev/null || true)
    if [ -z "$base" ] || [ "$base" = "$(git rev-parse HEAD)" ]; then
        base=$(git rev-parse --verify --quiet HEAD^ || git rev-parse HEAD)
    fi
fi

# One added line per output line, without the diff's own marks.
added() { git diff -U0 "$base" -- "${files[@]}" "${excluded[@]}" | grep -E '^\+[^+]' || true; }

# The entries of the list in docs/STYLE.md, one per line.
# shellcheck disable=SC2016 # the backquotes are text
entries() { sed -n '/^```smells/,/^```$/p' docs/STYLE.md | grep -v '^```' | sed 's/ ;; /\n/g'; }

# Hits of a pattern in the whole tree.
hits() { { git grep -ohiE "$1" -- "${files[@]}" "${excluded[@]}" || true; } | wc -l; }

if [ "$base" = --update ]; then
    list=$(entries | while read -r _ pattern; do echo "$(hits "$pattern") $pattern"; done)
    printf '%s\n' "$list"
    exit 0
fi

patterns=()
while read -r count pattern; do
    patterns+=("$pattern")
    found=$(hits "$pattern")
    if ((found > count)); then
        echo "warning: /$pattern/: $found hits, baseline $count in docs/STYLE.md"
    fi
done < <(entries)

lines=$(added)
for pattern in "${patterns[@]}"; do
    found=$(grep -ciE "${pattern#^ \*}" <<<"$lines" || true)
    if ((found > 0)); then
        echo "warning: /$pattern/: $found added lines since ${base:0:9}; see docs/STYLE.md"
    fi
done
git log --format=%s "$base.." | awk 'length > 72 { print "warning: subject over 72 characters: " $0 }'
if grep -niE "$never" <<<"$lines"; then
    echo "error: words and names in added lines that docs/STYLE.md replaces; see the list above" >&2
    exit 1
fi
