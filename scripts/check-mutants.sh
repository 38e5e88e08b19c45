#!/usr/bin/env bash
# Changes the code in small ways, one at a time, and reports those that no test of its crate notices (cargo-mutants).
#
#     scripts/check-mutants.sh                       names the parts
#     scripts/check-mutants.sh PART [COUNT [SEED]]   a random sample of a part, 150 mutants with seed 1
#
# A mutant survives if all tests pass; equivalent ones count, too. The tests of one may take 60 s: those that do not
# end have noticed it. Results: target/mutants/PART/mutants.out.
set -euo pipefail
cd "$(dirname "$0")/.."

# Package, folder and sources of what users trust blindly.
declare -A parts=(
    [image]="ecan-protocol ecan-protocol/src image/** sequence/**"
    [port]="ecan-mcan-port ecan-mcan-port/src transmit/** session/** schedule/** receiver.rs"
    [canopen]="ecan-canopen ecan-canopen/src cia301/** network/sdo/** network/pdo_mapping.rs network/producers.rs"
    [guard]="ecan-cia402 ecan-cia402/src guard/**"
    [motion]="ecan-cia402 ecan-cia402/src axis/target*.rs axis/ramp.rs axis/power.rs axis/takeover.rs table/path_stop.rs"
    [cycle]="ecan-host ecan-host/src exchange.rs cycle_timing.rs clocks.rs adapter/**"
    [service]="ecan-service ecan-service/src/server job_queue.rs output_queue.rs session.rs frame_feed.rs permission.rs"
    [boundary]="ecan-igh-host capi/igh-host/src handle.rs handle/** guard.rs guard/**"
)
part=${1-} count=${2:-150} seed=${3:-1}
[ -n "${parts[${part:-none}]-}" ] || {
    echo "usage: check-mutants.sh PART [COUNT [SEED]]; parts: $(printf '%s\n' "${!parts[@]}" | sort | xargs)" >&2
    exit 2
}
command -v cargo-mutants >/dev/null || cargo install --quiet --locked cargo-mutants

# Small builds, and the same cases of property tests in each run.
export CARGO_PROFILE_DEV_DEBUG=0 PROPTEST_RNG_SEED=1
unset CARGO_INCREMENTAL
set -f
read -r package folder sources <<<"${parts[$part]}"
selection=(--package "$package")
for source in $sources; do selection+=(--file "$folder/$source"); done
# An expression that matches the names of the sample only.
chosen=$(cargo mutants --list "${selection[@]}" | python3 -c "
import random, re, sys
names = sys.stdin.read().splitlines()
random.Random($seed).shuffle(names)
print('^(' + '|'.join(map(re.escape, names[:$count])) + ')\$')")

output=target/mutants/$part status=0
rm -rf "$output"
mkdir -p "$output"
cargo mutants "${selection[@]}" --re "$chosen" --no-shuffle --colors never --baseline skip --timeout 60 \
    --output "$output" || status=$?
# 2: some were not noticed; 3: the tests of some did not end.
case $status in 0 | 2 | 3) ;; *) exit "$status" ;; esac
