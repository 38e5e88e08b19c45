#!/usr/bin/env bash
# Makes the files of a release below DIR; publishes nothing. docs/VERSIONS.md describes them.
#
#     scripts/release.sh --output DIR [--dry-run]
#
# --dry-run   also with uncommitted changes or an unreleased version; quick: see docs/VERSIONS.md
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
output=
dry=
while (($#)); do
    case $1 in
    --output)
        output=${2:?--output needs a directory}
        shift
        ;;
    --dry-run) dry=yes ;;
    *)
        echo "release: unknown option \"$1\"; allowed: --output DIR, --dry-run" >&2
        exit 2
        ;;
    esac
    shift
done

step() { printf '== %s (%d s)\n' "$1" "$SECONDS"; }
fail() { printf 'release: %s\n' "$1" >&2; exit 1; }
# A dry run continues where a release ends.
require() { if [ -n "$dry" ]; then echo "dry run: $1"; else fail "$1"; fi; }

[ -n "$output" ] || { echo "release: --output DIR is missing" >&2; exit 2; }
mkdir -p "$output"
output=$(cd "$output" && pwd)
[ -z "$(ls -A "$output")" ] || fail "$output is not empty; name a new directory"

version=$(sed -n '/^\[workspace.package\]/,/^\[/s/^version = "\(.*\)"/\1/p' Cargo.toml)
name=ecan-lite-$version
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

step "version $version"
[ -z "$(git status --porcelain)" ] || require "the tree has uncommitted changes; commit them"
heading=$(grep -m 1 '^## ' CHANGELOG.md)
case $heading in
"## $version "*"(unreleased)"*) require "CHANGELOG.md: \"$heading\"; replace (unreleased) by the date" ;;
"## $version "* | "## $version") ;;
*) fail "CHANGELOG.md begins with \"$heading\", the version in Cargo.toml is $version" ;;
esac
if git rev-parse --verify --quiet "refs/tags/v$version" >/dev/null; then
    fail "the tag v$version exists; increase the version"
fi
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

step "interfaces since the last release"
baseline=$(git describe --tags --abbrev=0 --match 'v[0-9]*' 2>/dev/null || true)
if [ -z "$baseline" ]; then
    echo "no tag v*: this is the first release, without a baseline for cargo semver-checks"
elif cargo semver-checks --version >/dev/null 2>&1; then
    scripts/check-packages.sh --list | sed 's/^/--package=/' |
        xargs cargo semver-checks --baseline-rev "$baseline"
else
    require "cargo-semver-checks is missing; cargo install --locked cargo-semver-checks"
fi

# The same archive on each machine.
archive() { # FILE DIRECTORY NAME
    tar --create --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" \
        --directory "$2" "$3" | gzip --no-name --best >"$1"
}

step "source"
git archive --prefix="$name/" HEAD | gzip --no-name --best >"$output/$name.tar.gz"
tar --extract --directory "$work" --file "$output/$name.tar.gz"

step "crates"
scripts/check-packages.sh
mkdir "$output/crates"
scripts/check-packages.sh --list >"$output/crates/order"
while read -r crate; do
    cp "${CARGO_TARGET_DIR:-target}/package/$crate-$version.crate" "$output/crates/"
done <"$output/crates/order"

step "C libraries, twice"
triple=$(gcc -dumpmachine)
scripts/check-reproducible.sh ${dry:+--quick} --output "$work/$name-c-$triple"
archive "$output/$name-c-$triple.tar.gz" "$work" "$name-c-$triple"

if [ -z "$dry" ] && [ -x scripts/package.sh ]; then
    step "Debian packages"
    scripts/package.sh --output "$output/debian"
fi

step "documents"
scripts/build-book.sh "$work/$name-docs"
archive "$output/$name-docs.tar.gz" "$work" "$name-docs"

step "licences of the dependencies"
scripts/third-party-licenses.sh >"$output/THIRD-PARTY-LICENSES"

step "SBOM"
if cargo cyclonedx --version >/dev/null 2>&1; then
    mkdir "$output/sbom"
    # It writes into the directories of all crates: in the extracted source.
    cd "$work/$name"
    cargo cyclonedx --quiet --format json --spec-version 1.5 --no-build-deps --override-filename sbom
    for crate in capi/igh-host tools/ecan; do
        sed "s#$work/$name#/ecan-lite#g" "$crate/sbom.json" >"$output/sbom/$(basename "$crate").cdx.json"
    done
    cd "$root"
else
    require "cargo-cyclonedx is missing; cargo install --locked cargo-cyclonedx"
fi

step "checksums"
(
    cd "$output"
    find . -type f -printf '%P\n' | LC_ALL=C sort | xargs sha256sum >"$work/sums"
    mv "$work/sums" SHA256SUMS
    sha256sum --quiet --check SHA256SUMS
    wc --lines <SHA256SUMS | sed 's/$/ files/'
)
if [ -n "$dry" ]; then
    echo "dry run: the files in $output are not a release"
else
    echo "release $version in $output; next: git tag -a v$version, cargo publish in the order of crates/order"
fi
