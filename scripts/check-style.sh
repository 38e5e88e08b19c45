#!/usr/bin/env bash
# Searches for words that docs/STYLE.md replaces by standard terms: in the lines added since BASE, and
# by count in the whole tree. Fails when added lines contain one of the words that are never right.
#
#     scripts/check-style.sh [BASE]      default: the branch point from origin/main, else the last commit
set -euo pipefail
cd "$(dirname "$0")/.."

files=('*.rs' '*.md' '*.c' '*.h' '*.hpp' '*.cpp' '*.toml' '*.sh')
excluded=(':!include' ':!*STYLE.md' ':!scripts/check-style.sh' ':!CHANGELOG.md')
never='\b(amiss|mend(s|ed|ing)?|says? so|so many|unless told|in(to)? (and out of )?service|speaks? against)\b'

base=${1:-}
if [ -z "$base" ]; then
    base=$(git merge-base HEAD origin/main 2>/dev/null || true)
    if [ -z "$base" ] || [ "$base" = "$(git rev-parse HEAD)" ]; then
        base=$(git rev-parse --verify --quiet HEAD^ || git rev-parse HEAD)
    fi
fi

# One added line per output line, without the diff's own marks.
added() { git diff -U0 "$base" -- "${files[@]}" "${excluded[@]}" | grep -E '^\+[^+]' || true; }

patterns=()
while read -r count pattern; do
    patterns+=("$pattern")
    hits=$(git grep -ohiE "$pattern" -- "${files[@]}" "${excluded[@]}" | wc -l)
    if ((hits > count)); then
        echo "warning: /$pattern/: $hits hits, baseline $count in docs/STYLE.md"
    fi
done < <(sed -n '/^```smells/,/^```$/p' docs/STYLE.md | grep -v '^```' | sed 's/ ;; /\n/g')

lines=$(added)
for pattern in "${patterns[@]}"; do
    hits=$(grep -ciE "${pattern#^ \*}" <<<"$lines" || true)
    if ((hits > 0)); then
        echo "warning: /$pattern/: $hits added lines since ${base:0:9}; see docs/STYLE.md"
    fi
done
git log --format=%s "$base.." | awk 'length > 72 { print "warning: subject over 72 characters: " $0 }'
if grep -niE "$never" <<<"$lines"; then
    echo "error: words in added lines that docs/STYLE.md replaces; see the list above" >&2
    exit 1
fi
