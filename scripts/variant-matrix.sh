#!/usr/bin/env bash
# Runs the SDK with simulated gateways that differ from docs/ASSUMPTIONS.md, and prints the outcomes,
# which are in target/acceptance-variants/variants.md. Takes about a quarter of an hour.
#
#     scripts/variant-matrix.sh
#
# First the steps of the acceptance list with each alternative of `ecan-sim variants`, then random
# trials of motion with random faults; in 30 % of them the gateways have one to three alternatives.
# Fails if a step neither works nor ends with an error that names the assumption, or if a trial
# violates a rule.
set -euo pipefail
cd "$(dirname "$0")/.."
report=target/acceptance-variants
trials=2000

cargo build --quiet --locked -p ecan-tool -p ecan-examples --bins --examples
cargo build --quiet --locked --manifest-path checks/Cargo.toml --target-dir target -p ecan-acceptance
only=()
for group in startup/ demos/ commands/ configuration/apply faults/; do only+=(--only "$group"); done
status=0
scripts/acceptance.sh --bin target/debug --bin target/debug/examples --library sim --quick \
    --each-variant "${only[@]}" --except commands/bridge --except commands/no_library_noise \
    --report "$report" || status=1
TRIALS_FIRST=0 TRIALS_COUNT=$trials cargo test --quiet --release --locked -p ecan-cia402 \
    --test trials || status=1

cat "$report/variants.md"
exit $status
