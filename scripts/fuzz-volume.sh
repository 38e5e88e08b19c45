#!/usr/bin/env bash
# Runs fuzz targets for a number of executions each, one after the other, and sums them up:
#   scripts/fuzz-volume.sh run BINARIES DIRECTORY TARGET=EXECUTIONS...
#   scripts/fuzz-volume.sh sum DIRECTORY
#   scripts/fuzz-volume.sh seeds BINARIES DIRECTORY TARGET...
# BINARIES is the directory with the built targets, DIRECTORY takes corpora, findings and one log per run.
# `seeds` adds inputs of at most 512 bytes to checks/fuzz/seeds.tar.xz, as few as reach every code that the corpus reaches.
# A run ends at a finding; the next one continues with the remaining executions, ten runs at most.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
seeds=$root/target/fuzz/seeds
mkdir -p "$root/target/fuzz"
tar --extract --xz --file "$root/checks/fuzz/seeds.tar.xz" --directory "$root/target/fuzz"

# Executions in a log: the final count, or the last count of a run that is in progress or found something.
executions() {
    grep -aoE '^Done [0-9]+|^#[0-9]+' "$1" | tail -1 | grep -oE '[0-9]+' || echo 0
}

run() {
    local binaries=$1 directory=$2 target log share left attempt
    shift 2
    mkdir -p "$directory/logs" "$directory/findings"
    for share in "$@"; do
        target=${share%%=*}
        left=${share#*=}
        local options=() begin=()
        if [[ -f $root/checks/fuzz/words/$target.dict ]]; then options+=("-dict=$root/checks/fuzz/words/$target.dict"); fi
        if [[ -d $seeds/$target ]]; then begin=("$seeds/$target"); fi
        mkdir -p "$directory/corpus/$target"
        for attempt in {1..10}; do
            log=$directory/logs/$target.$(date +%s).$attempt
            "$binaries/$target" "-runs=$left" -max_len="${MAX_LEN:-4096}" -timeout=10 -rss_limit_mb=2048 \
                -print_final_stats=1 "-artifact_prefix=$directory/findings/$target-" "${options[@]}" \
                "$directory/corpus/$target" "${begin[@]}" > "$log" 2>&1 && break
            left=$((left - $(executions "$log")))
            if ((left <= 0)); then break; fi
        done
    done
}

sum() {
    local directory=$1 log target count total=0
    local -A by_target=() coverage=()
    for log in "$directory"/logs/*; do
        target=$(basename "$log")
        target=${target%%.*}
        count=$(executions "$log")
        by_target[$target]=$((${by_target[$target]:-0} + count))
        total=$((total + count))
        coverage[$target]=$(grep -aoE 'cov: [0-9]+' "$log" | tail -1 | grep -oE '[0-9]+' || echo 0)
    done
    for target in $(printf '%s\n' "${!by_target[@]}" | sort); do
        echo "$target: ${by_target[$target]} executions, ${coverage[$target]} counters covered"
    done
    echo "total: $total executions, $(find "$directory/findings" -type f | wc -l) findings"
}

seeds() {
    local binaries=$1 directory=$2 target
    shift 2
    for target in "$@"; do
        mkdir -p "$seeds/$target"
        "$binaries/$target" -set_cover_merge=1 -use_counters=0 -max_len=512 \
            "$seeds/$target" "$directory/corpus/$target" > "$directory/seeds.$target.log" 2>&1
    done
    tar --create --xz --sort=name --mtime=@0 --owner=0 --group=0 --numeric-owner \
        --file "$root/checks/fuzz/seeds.tar.xz" --directory "$root/target/fuzz" seeds
}

case ${1:-} in
    run) run "${@:2}" ;;
    sum) sum "$2" ;;
    seeds) seeds "${@:2}" ;;
    *)
        echo "fuzz-volume.sh: unknown command \"${1:-}\"; allowed: run, sum, seeds" >&2
        exit 2
        ;;
esac
