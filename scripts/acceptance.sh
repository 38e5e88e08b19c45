#!/usr/bin/env bash
# Runs the acceptance list of the SDK on an EtherCAT master (docs/TESTING.md):
#
#     scripts/acceptance.sh --library PATH --ethercat PATH --interface IF [--gateways N] [--quick]
#     scripts/acceptance.sh --library PATH --ethercat PATH --device [--gateways N] [--quick]
#     scripts/acceptance.sh --library sim
#
# The master listens on one end of a cable or veth pair; simulated gateways are started on IF, its
# other end, or real gateways are connected (--device). Builds the programs, unless --bin DIR names
# directories that contain them. --help prints all options, --list all steps.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

bins=()
arguments=("$@")
while (($#)); do
    case $1 in
    --bin)
        [ $# -gt 1 ] || { echo "acceptance.sh: --bin needs a directory" >&2; exit 2; }
        bins+=("$2")
        shift 2
        ;;
    --bin=*)
        bins+=("${1#--bin=}")
        shift
        ;;
    *) shift ;;
    esac
done

if ((${#bins[@]} == 0)); then
    target=${CARGO_TARGET_DIR:-$root/target}
    for argument in "$@"; do
        case $argument in
        -h | --help | --list)
            exec cargo run --manifest-path "$root/checks/Cargo.toml" --target-dir "$target" --locked --quiet -p ecan-acceptance -- "$@"
            ;;
        esac
    done
    command -v cargo >/dev/null || {
        echo "acceptance.sh: no cargo to build the programs; name their directories with --bin" >&2
        exit 2
    }
    cargo build --manifest-path "$root/Cargo.toml" --release --locked --quiet \
        -p ecan-tool -p ecan-examples --bins --examples
    cargo build --manifest-path "$root/checks/Cargo.toml" --target-dir "$target" --release --locked --quiet \
        -p ecan-acceptance
    bins=("$target/release" "$target/release/examples")
    if command -v cmake >/dev/null; then
        cmake -S "$root" -B "$target/acceptance" -DECAN_CARGO_TARGET_DIR="$target" -DBUILD_TESTING=OFF >/dev/null
        cmake --build "$target/acceptance" >/dev/null
        bins+=("$target/acceptance")
    else
        echo "acceptance.sh: no cmake; the steps of the C programs are skipped" >&2
    fi
    for bin in "${bins[@]}"; do arguments+=(--bin "$bin"); done
fi

for bin in "${bins[@]}"; do
    if [ -x "$bin/ecan-acceptance" ]; then
        exec "$bin/ecan-acceptance" --scripts "$root/scripts" "${arguments[@]}"
    fi
done
echo "acceptance.sh: no program ecan-acceptance in ${bins[*]}" >&2
exit 2
