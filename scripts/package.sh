#!/usr/bin/env bash
# Builds Debian packages of the programs, the libraries, the simulated libethercat and the Wireshark
# plug-in, or a static `ecan`. On Debian 12, with cmake and debhelper; for arm64 on another processor
# also gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user-static.
set -euo pipefail
export LC_ALL=C

usage() {
    cat <<'END'
Usage: scripts/package.sh --output DIR [OPTIONS]

Options:
  --output DIR         folder of the packages; files of the same names are replaced
  --arch ARCH          amd64 or arm64 [default: this machine]
  --static             build only ecan-VERSION-ARCH-static, which needs no library of the system
  --maintainer TEXT    "NAME <MAIL>" of the packages [default: DEBFULLNAME and DEBEMAIL]
  --programs DIR       pack the existing ecan and ecan-sim of this folder, such as target/debug

An unreleased version is packed as VERSION~TIME of the last commit.
END
}

fail() { # STATUS MESSAGE
    printf 'package: %s\n' "$2" >&2
    exit "$1"
}

output='' arch=$(dpkg --print-architecture) static='' programs=''
maintainer="${DEBFULLNAME:-ECAN-Lite host SDK} <${DEBEMAIL:-ecan-lite@example.org}>"
while (($#)); do
    case $1 in
    --output | --arch | --maintainer | --programs)
        (($# > 1)) || fail 2 "$1 needs a value"
        declare "${1#--}=$2"
        shift
        ;;
    --static) static=yes ;;
    -h | --help)
        usage
        exit
        ;;
    *) fail 2 "unknown option \"$1\"; see --help" ;;
    esac
    shift
done
[[ $output ]] || fail 2 "--output is missing; see --help"
case $arch in
amd64) machine=x86_64 ;;
arm64) machine=aarch64 ;;
*) fail 2 "--arch $arch: no packages for it; allowed: amd64 and arm64" ;;
esac
[[ -z $programs || -x $programs/ecan && -x $programs/ecan-sim ]] ||
    fail 2 "--programs $programs: ecan or ecan-sim is missing; build -p ecan-tool"
output=$(realpath --canonicalize-missing "$output")
[[ -z $programs ]] || programs=$(realpath "$programs")
mkdir -p "$output"
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-$PWD/target}

# Reproducible: nothing in the packages has the time of the build.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}
export SOURCE_DATE_EPOCH
release=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml)
version=$release
if grep -q "^## $release (unreleased)" CHANGELOG.md; then
    version=$release~$(date --utc --date="@$SOURCE_DATE_EPOCH" +%Y%m%d%H%M%S)
fi

if [[ $static ]]; then
    # No path of this machine in the program.
    sysroot=$(rustc --print sysroot)
    export RUSTFLAGS="--remap-path-prefix=${CARGO_HOME:-$HOME/.cargo}=/cargo
        --remap-path-prefix=$sysroot=/rust --remap-path-prefix=$PWD=/ecan-lite"
    rust_target=$machine-unknown-linux-musl
    rustup target add "$rust_target" >/dev/null 2>&1 || fail 1 "rustup cannot add the target $rust_target"
    # The linker of Rust links for each processor; no C code of another compiler is in the program.
    export CARGO_TARGET_X86_64_UNKNOWN_LINUX_MUSL_LINKER=rust-lld
    export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_MUSL_LINKER=rust-lld
    cargo build --release --locked --quiet -p ecan-tool --target "$rust_target" --target-dir "$target"
    install -m 755 "$target/$rust_target/release/ecan" "$output/ecan-$version-$arch-static"
    echo "$output/ecan-$version-$arch-static"
    exit
fi

command -v dh >/dev/null || fail 1 "dh is missing; install debhelper"
command -v cmake >/dev/null || fail 1 "cmake is missing; install cmake"
triplet=$machine-linux-gnu
cross=()
if [[ $arch != "$(dpkg --print-architecture)" ]]; then
    for tool in "$triplet-gcc" "qemu-$machine-static"; do
        command -v "$tool" >/dev/null ||
            fail 1 "$tool is missing; install gcc-$triplet, libc6-dev-$arch-cross and qemu-user-static"
    done
    rustup target add "$machine-unknown-linux-gnu" >/dev/null 2>&1 ||
        fail 1 "rustup cannot add the target $machine-unknown-linux-gnu"
    cross=(-DCMAKE_SYSTEM_NAME=Linux "-DCMAKE_SYSTEM_PROCESSOR=$machine"
        "-DCMAKE_C_COMPILER=$triplet-gcc"
        "-DCMAKE_CROSSCOMPILING_EMULATOR=qemu-$machine-static;-L;/usr/$triplet")
fi

# ---- build

work=$target/debian/$arch
source=$work/source
tree=$source/tree
rm -rf "$source"
mkdir -p "$tree" "$source/debian"
build() { # FOLDER OPTIONS...
    cmake -S . -B "$work/$1" "${cross[@]}" "${@:2}" -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_INSTALL_PREFIX=/usr "-DCMAKE_INSTALL_LIBDIR=lib/$triplet" \
        -DCMAKE_INSTALL_DOCDIR=share/doc/libecan-lite-dev \
        -DCMAKE_SKIP_RPATH=ON -DBUILD_TESTING=OFF "-DECAN_CARGO_TARGET_DIR=$target" \
        >"$work/$1.log" || { cat "$work/$1.log"; exit 1; }
    cmake --build "$work/$1" --parallel 2 >>"$work/$1.log" || { tail -n 40 "$work/$1.log"; exit 1; }
}
build without-sim -DECAN_IGH_SIM=OFF
build with-sim -DECAN_TOOLS=ON "-DECAN_TOOLS_DIR=$programs"

# ---- install

libraries=usr/lib/$triplet
DESTDIR=$tree cmake --install "$work/with-sim" >"$work/install.log"
DESTDIR=$work/plain cmake --install "$work/without-sim" >"$work/install.log"
plain=$tree/$libraries/ecan-lite/without-sim
mkdir -p "$plain" "$tree/$libraries/ecan-lite/sim" "$tree/$libraries/wireshark/plugins"
cp -P "$work/plain/$libraries"/libecan_igh_host.* "$plain"
folder="\${libdir}/ecan-lite/without-sim"
sed -e 's/^Name: .*/&_without_sim/' -e 's/^Description: .*/&, without the simulator/' \
    -e "s#^Libs: #&-L$folder -Wl,-rpath,/$libraries/ecan-lite/without-sim #" \
    "$tree/$libraries/pkgconfig/ecan_igh_host.pc" \
    >"$tree/$libraries/pkgconfig/ecan_igh_host_without_sim.pc"
cp -P "$work/with-sim/sim"/libethercat.so* "$tree/$libraries/ecan-lite/sim"

documents=$tree/usr/share/doc
# Their texts are in the file copyright.
rm "$documents"/libecan-lite-dev/LICENSE-*
mkdir "$documents/ecan-lite-wireshark"
mv "$documents/libecan-lite-dev/packaging/wireshark/ecan_pdo.lua" "$tree/$libraries/wireshark/plugins"
mv "$documents/libecan-lite-dev/packaging/wireshark/README.md" "$documents/ecan-lite-wireshark"
rmdir -p --ignore-fail-on-non-empty "$documents/libecan-lite-dev/packaging/wireshark"
install -D -m 644 -t "$tree/usr/share/ecan-lite/scenarios" examples/scenarios/*.toml
install -D -m 644 -t "$tree/usr/share/ecan-lite/scenarios/network" examples/network/*
install -D -m 644 packaging/debian/ecan-lite.limits "$tree/etc/security/limits.d/ecan-lite.conf"
for unit in tools/ecan/systemd/*.service tools/ecan/systemd/*.socket; do
    install -D -m 644 -t "$tree/lib/systemd/system" "$unit"
done
sed -i 's#/usr/local/bin/#/usr/bin/#' "$tree"/lib/systemd/system/*.service
install -D -m 644 -t "$tree/usr/share/ecan-lite/systemd" tools/ecan/systemd/*.conf

# ---- pack

soversion=$(readelf -d "$tree/$libraries/libecan_igh_host.so" |
    sed -n 's/.*(SONAME).*\[libecan_igh_host\.so\.\(.*\)\]/\1/p')
for file in packaging/debian/*; do
    name=$(basename "$file")
    sed -e "s/@SOVERSION@/$soversion/g" -e "s/@RELEASE@/$release/g" \
        -e "s/@INTERFACE@/${release%.*}/" -e "s/@MAINTAINER@/$maintainer/" \
        -e "s/@VERSION@/$version/" "$file" >"$source/debian/${name/#library./libecan-igh-host$soversion.}"
done
# Of the licence, without its title and copyright line; empty lines as the format of the file needs them.
tail -n +5 LICENSE-MIT | sed 's/^$/./; s/^/ /' >"$work/mit"
sed -i -e "/^@MIT@$/{r $work/mit" -e 'd}' "$source/debian/copyright"
chmod +x "$source/debian/rules"
scripts/third-party-licenses.sh >"$source/debian/THIRD-PARTY-LICENSES"
{
    printf 'ecan-lite (%s) unstable; urgency=medium\n\n' "$version"
    printf '  * Changes: CHANGELOG.md in libecan-lite-dev.\n\n'
    printf ' -- %s  %s\n' "$maintainer" "$(date --utc --rfc-email --date="@$SOURCE_DATE_EPOCH")"
} >"$source/debian/changelog"
# Fast: the same content is packed often in CI.
export DEB_BUILD_OPTIONS="nocheck parallel=2"
(cd "$source" && dpkg-architecture --host-arch "$arch" --command debian/rules binary) \
    >"$work/packages.log" 2>&1 || { tail -n 40 "$work/packages.log"; exit 1; }
for package in "$work"/*.deb; do
    mv "$package" "$output"
    echo "$output/$(basename "$package")"
done
