# Sourced by the stages: the environment of the builds, and the installation of tools.
# shellcheck shell=bash
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# Incremental data of a build that runs once only doubles the disk space.
export CARGO_INCREMENTAL=0
# Panics name their line without it.
export CARGO_PROFILE_DEV_DEBUG=0
# The property tests generate the same cases in each run, so that a failure is reproducible.
export PROPTEST_RNG_SEED=1
# Many tests wait for programs in real time.
export RUST_TEST_THREADS=8
export RUSTC_WORKSPACE_WRAPPER=$PWD/.ci/rustc

peers=$PWD/target/python-peers
unpacked=$PWD/target/debian-packages
# Options of cargo for the workspace of the checks. Of what the other one has compiled it uses crates of the registry;
# a path has another meaning in each workspace.
checks=(--manifest-path checks/Cargo.toml --target-dir target)
# Its crates without the peers and fuzz targets, which have other features: the stage `peers`.
checked=(-p ecan-acceptance -p ecan-bench -p ecan-headers -p ecan-soak --bins --tests)
# The age of the package lists, and the lock of the installations.
lists=$PWD/target/.lists
mkdir -p target

step() { printf -- '-- %s\n' "$1"; }

# Runs a command alone: stages beside each other install packages.
lock=$PWD/target/.packages.lock
locked() { flock "$lock" "$@"; }

# Installs the Debian packages whose tools are missing: pairs of tool and package.
install_tools() {
    local packages=()
    while (($#)); do
        command -v "$1" >/dev/null || packages+=("$2")
        shift 2
    done
    ((${#packages[@]})) || return 0
    update_lists
    DEBIAN_FRONTEND=noninteractive \
        locked apt-get install -y -qq --no-install-recommends "${packages[@]}"
}

# Updates the package lists, unless an earlier stage has within the hour.
update_lists() {
    [ -n "$(find "$lists" -mmin -60 2>/dev/null)" ] || locked apt-get update -qq
    touch "$lists"
}

# Unpacks Debian packages without their dependencies, which the programs in use do not need.
unpack() {
    mkdir -p "$unpacked"
    update_lists
    local package
    for package; do
        rm -f "$unpacked/$package"_*.deb
        (cd "$unpacked" && locked apt-get download -qq -o APT::Sandbox::User=root "$package")
        dpkg-deb -x "$unpacked/$package"_*.deb "$unpacked"
    done
}

# Installs the packages of these requirements into an environment for the peers in Python.
install_peers() {
    python3 -c 'import ensurepip, venv' 2>/dev/null || install_tools no-such-tool python3-venv
    # Created again when it is broken, for example after an update of the system's Python.
    "$peers/bin/python" -c 'import pip' 2>/dev/null || python3 -m venv --clear "$peers"
    locked "$peers/bin/python" -m pip install --quiet --disable-pip-version-check "${@/#/--requirement=}"
}

# With the targets of the stages `test` and `checks`: fewer would have other features, and compile anew.
build_programs() {
    cargo test --quiet --locked --workspace --no-run
    cargo test --quiet --locked "${checks[@]}" "${checked[@]}" --benches --no-run
}
