#!/usr/bin/env bash
# Builds the site of the documents and checks its links, also to anchors.
#
#     scripts/build-book.sh [DIRECTORY]      default: target/book
#
# Needs mdbook (cargo install --locked mdbook; or its binary, which scripts/book-requirements.txt installs
# by pip) and python3.
set -euo pipefail
cd "$(dirname "$0")/.."
output=${1:-target/book}
mdbook=${MDBOOK:-mdbook}
command -v "$mdbook" >/dev/null ||
    { echo "build-book: $mdbook is missing; cargo install --locked mdbook" >&2; exit 1; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp docs/book.toml "$work"
mkdir "$work/src"

# The documents keep their places, so that their links to each other hold; the root of the site is the root
# of the project.
git ls-files --cached --others --exclude-standard '*.md' docs/pictures | while read -r file; do
    mkdir -p "$work/src/$(dirname "$file")"
    cp "$file" "$work/src/$file"
done
sed -e 's#](\.\./#](#' -e t -e 's#](#](docs/#' docs/SUMMARY.md >"$work/src/SUMMARY.md"
rm "$work/src/docs/SUMMARY.md"
# Other files that the documents link.
(cd "$work/src" && grep -roE --include='*.md' '\]\([^)#:]+[)#]' . | sed -e 's#^\./\([^:]*\):\](#\1 #' -e 's#.$##') |
    while read -r document link; do
        file=$(realpath --relative-to=. --canonicalize-missing "$(dirname "$document")/$link")
        case $file in
        *.md | ../*) ;;
        *)
            mkdir -p "$work/src/$(dirname "$file")"
            cp -rn "$file" "$work/src/$(dirname "$file")/"
            ;;
        esac
    done

"$mdbook" build "$work" >"$work/log" 2>&1 || { cat "$work/log" >&2; exit 1; }
if grep -E 'WARN|ERROR' "$work/log" >&2; then
    exit 1
fi
rm -rf "$output"
mkdir -p "$(dirname "$output")"
cp -r "$work/book" "$output"
scripts/check-links.py "$output"
