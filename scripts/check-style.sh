#!/usr/bin/env bash
# Fails if a line added since BASE contains a word that the glossary of CONTRIBUTING.md never permits or a
# closure with the argument `it`. Warns if the subject of a commit since BASE has more than 72 characters.
#
#     scripts/check-style.sh [BASE]      default: the branch point from origin/main, else the last commit
set -euo pipefail
cd "$(dirname "$0")/.."

files=('*.rs' '*.md' '*.c' '*.h' '*.hpp' '*.cpp' '*.toml' '*.sh')
excluded=(':!include' ':!CONTRIBUTING.md' ':!scripts/check-style.sh')
never='\b(amiss|mend(s|ed|ing)?|says? so|so many|unless told|in(to)? (and out of )?service|speaks? against)\b|\|it\|'

base=${1:-}
if [ -z "$base" ]; then
    base=$(git merge-base HEAD origin/main 2>/dev/null || true)
    if [ -z "$base" ] || [ "$base" = "$(git rev-parse HEAD)" ]; then
        base=$(git rev-parse --verify --quiet HEAD^ || git rev-parse HEAD)
    fi
fi

git log --format=%s "$base.." | awk 'length > 72 { print "warning: subject over 72 characters: " $0 }'
if git diff -U0 "$base" -- "${files[@]}" "${excluded[@]}" | grep -E '^\+[^+]' | grep -niE "$never"; then
    echo "error: words or closures in added lines that CONTRIBUTING.md replaces; see the list above" >&2
    exit 1
fi
