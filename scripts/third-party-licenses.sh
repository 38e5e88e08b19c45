#!/usr/bin/env bash
# Prints the crates of other authors in the programs and libraries, with their licences, then each
# licence text once. The same for every processor of the packages.
set -euo pipefail
cd "$(dirname "$0")/.."
export LC_ALL=C
packages=(ecan-tool ecan-mcan-host ecan-igh-host ecan-sim-ethercat)

crates=$(
    for target in x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu; do
        cargo fetch --quiet --locked --target "$target"
        cargo tree --quiet --locked --edges normal --target "$target" --prefix none \
            --format '{p}|{l}|{r}' "${packages[@]/#/--package=}"
    done | sort -u
)
declare -A users=() texts=()
echo "Code of other authors, with licence and repository"
echo
echo "Rust standard library: MIT OR Apache-2.0, https://github.com/rust-lang/rust"
while IFS='|' read -r crate license repository; do
    # Crates of this workspace have their folder, macros a remark.
    crate=${crate% (proc-macro)}
    [[ $crate && $crate != *" ("* ]] || continue
    printf '%s: %s, %s\n' "$crate" "$license" "$repository"
    name=${crate/ v/-}
    for file in "${CARGO_HOME:-$HOME/.cargo}"/registry/src/*/"$name"/{LICEN[CS]E,COPYING,COPYRIGHT,NOTICE,UNLICENSE}*; do
        [[ -f $file ]] || continue
        sum=$(sha256sum <"$file")
        users[$sum]+="${users[$sum]:+, }$name"
        texts[$sum]=$file
    done
done <<<"$crates"
# In the order of the crates, not of the table.
for sum in "${!users[@]}"; do
    printf '%s\t%s\n' "${users[$sum]}" "$sum"
done | sort | while IFS=$'\t' read -r names sum; do
    printf '\n%s\n' "======================================================================"
    fold --spaces --width=98 <<<"$names"
    echo
    cat "${texts[$sum]}"
done
