#!/usr/bin/env bash
# Changes the code in small ways, one at a time, and reports those that no test of its crate notices (cargo-mutants).
#
#     scripts/check-mutants.sh                       names the parts
#     scripts/check-mutants.sh PART [COUNT [SEED]]   a random sample of a part, 150 mutants with seed 1
#     scripts/check-mutants.sh changed [COUNT [SEED]]
#         of the lines changed since the last tag, or by the last 20 commits
#
# Works on the last commit. A mutant survives if all tests pass; equivalent ones count, too. The tests of one may take
# 60 s: those that do not end have noticed it. Results: target/mutants/PART/mutants.out; previously_caught.txt has
# those that unit tests notice, which are tried first.
set -euo pipefail
cd "$(dirname "$0")/.."

# Folder of a package, and its sources, of what users trust blindly.
declare -A parts=(
    [image]="ecan-protocol image/** sequence/**"
    [port]="ecan-mcan-port transmit/** session/** schedule/** receiver.rs"
    [canopen]="ecan-canopen cia301/** network/sdo/** network/pdo_mapping.rs network/producers.rs"
    [guard]="ecan-cia402 guard/**"
    [motion]="ecan-cia402 axis/target*.rs axis/ramp.rs axis/power.rs axis/takeover.rs table/path_stop.rs"
    [cycle]="ecan-host exchange.rs cycle_timing.rs clocks.rs adapter/**"
    [service]="ecan-service server job_queue.rs output_queue.rs session.rs frame_feed.rs permission.rs"
    [boundary]="capi/igh-host handle.rs handle/** guard.rs guard/**"
    [changed]=""
)
part=${1-} count=${2:-150} seed=${3:-1}
[ -n "${parts[${part:-none}]+known}" ] || {
    echo "usage: check-mutants.sh PART [COUNT [SEED]]; parts: $(printf '%s\n' "${!parts[@]}" | sort | xargs)" >&2
    exit 2
}
command -v cargo-mutants >/dev/null || cargo install --quiet --locked cargo-mutants

# Small builds, and the same cases of property tests in each run.
export CARGO_PROFILE_DEV_DEBUG=0 PROPTEST_RNG_SEED=1
unset CARGO_INCREMENTAL
output=$PWD/target/mutants/$part tree=$PWD/target/mutants/tree
rm -rf "$output"
mkdir -p "$output"
git worktree prune
if [ -d "$tree" ]; then
    git -C "$tree" checkout --quiet --force --detach "$(git rev-parse HEAD)"
else
    git worktree add --quiet --detach "$tree"
fi
cd "$tree"

set -f
selection=()
if [ "$part" = changed ]; then
    base=$(git describe --tags --abbrev=0 2>/dev/null || git rev-parse --verify --quiet HEAD~20 || git rev-list HEAD | tail -1)
    git diff "$base" -- '*/src/*.rs' >"$output/diff"
    selection+=(--in-diff "$output/diff")
else
    read -r folder sources <<<"${parts[$part]}"
    for source in $sources; do selection+=(--file "$folder/src/$source"); done
fi
# An expression that matches the names of the sample only.
chosen=$(cargo mutants --list "${selection[@]}" | python3 -c "
import random, re, sys
names = sys.stdin.read().splitlines()
random.Random($seed).shuffle(names)
print('^(' + '|'.join(map(re.escape, names[:$count])) + ')\$')")

try_sample() { # ARGUMENTS OF CARGO TEST...
    local status=0
    cargo mutants "${selection[@]}" --re "$chosen" --in-place --colors never --baseline skip --timeout 60 \
        --iterate --output "$output" "$@" || status=$?
    # 2: some were not noticed; 3: the tests of some did not end.
    case $status in 0 | 2 | 3) ;; *) exit "$status" ;; esac
}
try_sample -- --lib
try_sample
