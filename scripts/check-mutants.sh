#!/usr/bin/env bash
# Changes the code in small ways, one at a time, and reports those that no test of its crate notices (cargo-mutants).
#
#     scripts/check-mutants.sh                       names the parts
#     scripts/check-mutants.sh PART [COUNT [SEED]]   a random sample of a part, 150 mutants with seed 1
#     scripts/check-mutants.sh changed [COUNT [SEED]]
#         of the lines that changed since the last tag, or in the last 20 commits, in the lowest crate
#
# Works on the last commit. A mutant survives if all tests pass; equivalent ones count, too. The tests of one may take
# 60 s: those that do not end have noticed it. Those that unit tests notice are found first, which is quick. Fails if
# more than a tenth survives, of changed lines more than a quarter. MUTANTS_SECONDS ends it earlier. Results:
# target/mutants/PART/mutants.out; previously_caught.txt has those that unit tests notice, and those that do not compile.
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
    [service]="ecan-service server/client.rs server/frame_feed.rs server/job_queue.rs server/output_queue.rs
        server/permission.rs server/session.rs"
    [boundary]="capi/igh-host [!t]*.rs adapter/** canopen/[!t]*.rs cia402/[!t]*.rs mcan_port/**"
)
part=${1-} count=${2:-150} seed=${3:-1} most=10
[ -n "${parts[${part:-none}]-}" ] || [ "$part" = changed ] || {
    names=$(printf '%s\n' "${!parts[@]}" | sort | xargs)
    echo "usage: check-mutants.sh PART [COUNT [SEED]]; parts: $names, changed" >&2
    exit 2
}
command -v cargo-mutants >/dev/null || cargo install --quiet --locked cargo-mutants

# Small builds, and the same cases of property tests in each run.
export CARGO_PROFILE_DEV_DEBUG=0 PROPTEST_RNG_SEED=1
unset CARGO_INCREMENTAL RUSTC_WORKSPACE_WRAPPER
output=$PWD/target/mutants/$part tree=$PWD/target/mutants/tree
rm -rf "$output"
mkdir -p "$output"
git worktree prune
if [ -d "$tree" ]; then
    git -C "$tree" checkout --quiet --force --detach "$(git rev-parse HEAD)"
else
    git worktree add --quiet --detach "$tree"
    # The crates of others are compiled already.
    for folder in .fingerprint build deps; do
        [ -d "target/debug/$folder" ] || continue
        mkdir -p "$tree/target/debug/$folder"
        find "target/debug/$folder" -mindepth 1 -maxdepth 1 \( -type d -o -name 'lib*' -o -name '*.d' \) \
            ! -name '*ecan*' ! -name '*ecrt*' -exec cp -a -t "$tree/target/debug/$folder" {} +
    done
fi
cd "$tree"

set -f
selection=()
select_sources() { # FOLDER SOURCES...
    for source in "${@:2}"; do selection+=(--file "$1/src/$source"); done
}
if [ "$part" = changed ]; then
    most=25
    base=$(git describe --tags --abbrev=0 2>/dev/null || git rev-parse --verify --quiet HEAD~20 ||
        git rev-list --max-parents=0 HEAD | tail -1)
    git diff "$base" -- '*.rs' >"$output/diff"
    selection+=(--in-diff "$output/diff")
    # shellcheck disable=SC2086 # words
    for chosen in "${parts[@]}"; do select_sources $chosen; done
else
    # shellcheck disable=SC2086 # words
    select_sources ${parts[$part]}
fi
# An expression that matches the names of the sample only; of a change, those of the lowest crate: it compiles fast.
chosen=$(cargo mutants --list "${selection[@]}" | python3 -c "
import random, re, sys
names, draw = sys.stdin.read().splitlines(), random.Random($seed)
draw.shuffle(names)
if '$part' == 'changed' and names:
    layers = 'protocol host mcan-port canopen service cia402 igh-host'.split()
    layer_of = lambda name: next(at for at, crate in enumerate(layers) if crate in name.split('/src/')[0])
    lowest = min(map(layer_of, names))
    names = [name for name in names if layer_of(name) == lowest]
print('^(' + '|'.join(map(re.escape, names[:$count])) + ')\$' if names else '')")
[ -n "$chosen" ] || { echo "no line of these parts has a mutant"; exit; }

end=${MUTANTS_SECONDS:-0}
is_over() { ((end > 0 && SECONDS >= end)); }
try_sample() { # ARGUMENTS OF CARGO TEST...
    local status=0 limit=()
    ((end == 0)) || limit=(timeout --signal=INT "$((end - SECONDS))")
    "${limit[@]}" cargo mutants "${selection[@]}" --re "$chosen" --all-features --in-place --colors never \
        --baseline skip --timeout 60 --iterate --output "$output" "$@" || status=$?
    # 2: some were not noticed; 3: the tests of some did not end; 124, 130: the time is over.
    case $status in 0 | 2 | 3 | 124 | 130) ;; *) exit "$status" ;; esac
}
count_of() { # RESULTS...
    (cd "$output/mutants.out" && cat "${@/%/.txt}" | wc -l)
}

try_sample -- --lib
noticed=$(count_of caught) missed=0
if (($(count_of missed timeout) > 0)) && ! is_over; then
    try_sample
    noticed=$((noticed + $(count_of caught timeout))) missed=$(count_of missed)
fi
echo "$part: $noticed noticed, $missed survive"
((missed * 100 <= most * (noticed + missed)))
