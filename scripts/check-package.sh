#!/usr/bin/env bash
# Proves the Debian packages of scripts/package.sh: installs them in a clean Debian 12 root without
# Rust and without network, uses the programs, compiles programs of C by pkg-config and by CMake, runs
# the service by its unit, and purges them: nothing remains. As root, with mmdebstrap; for arm64 on
# another processor with qemu-user-static and arch-test.
#
#     scripts/check-package.sh DIR [--arch amd64|arm64] [--root FILE.tar] [--wireshark]
#
# --root uses this tar file as the clean root, and makes it if it does not exist. --wireshark also
# installs and loads the Wireshark plug-in, for which the root contains tshark.
set -euo pipefail
export LC_ALL=C

fail() {
    printf 'check-package: %s\n' "$1" >&2
    exit "${2:-1}"
}
say() { printf -- '-- %s (%d s)\n' "$1" "$SECONDS"; }

directory='' arch=$(dpkg --print-architecture) tar='' wireshark=''
while (($#)); do
    case $1 in
    --arch | --root)
        (($# > 1)) || fail "$1 needs a value" 2
        if [[ $1 = --arch ]]; then arch=$2; else tar=$2; fi
        shift
        ;;
    --wireshark) wireshark=yes ;;
    -*) fail "unknown option \"$1\"; allowed: --arch, --root and --wireshark" 2 ;;
    *) directory=$1 ;;
    esac
    shift
done
[[ ! $tar ]] || tar=$(realpath "$tar")
[[ -d $directory ]] || fail "\"$directory\" is not a folder; name the one of package.sh --output" 2
directory=$(realpath "$directory")
cd "$(dirname "$0")/.."
case $arch in
amd64) machine=x86_64 ;;
arm64) machine=aarch64 ;;
*) fail "--arch $arch: no packages for it; allowed: amd64 and arm64" 2 ;;
esac
[[ $(id -u) = 0 ]] || fail "mounts and chroot need root"
if [[ ! ${ECAN_CHECK_NAMESPACE-} ]]; then
    # Processors that the kernel cannot run are emulated for as long as this script runs.
    binfmt=/proc/sys/fs/binfmt_misc
    remove=''
    trap 'eval "$remove"' EXIT
    if [[ $arch != "$(dpkg --print-architecture)" && ! -e $binfmt/qemu-$machine ]]; then
        [[ -e $binfmt/register ]] || mount -t binfmt_misc binfmt_misc "$binfmt"
        [[ -e /usr/lib/binfmt.d/qemu-$machine.conf ]] || fail "qemu is missing; install qemu-user-static"
        cat "/usr/lib/binfmt.d/qemu-$machine.conf" >"$binfmt/register"
        remove="echo -1 >$binfmt/qemu-$machine;"
    fi
    # Mounts and processes end with this script, and there is no network.
    arguments=("$directory" --arch "$arch")
    [[ -z $tar ]] || arguments+=(--root "$tar")
    [[ -z $wireshark ]] || arguments+=(--wireshark)
    if [[ ! $tar || ! -e $tar ]]; then
        made=${tar:-$(mktemp --suffix=.tar)}
        [[ $tar ]] || arguments+=(--root "$made")
        [[ $tar ]] || remove+="rm -f '$made'"
        say "clean Debian 12 root for $arch"
        # adduser for the packages, the others for programs of C and C++.
        include=adduser,g++,pkg-config,cmake,make${wireshark:+,tshark}
        mmdebstrap --quiet --variant=apt --architectures="$arch" --include="$include" \
            --aptopt='APT::Install-Recommends "false"' bookworm "$made" /etc/apt/sources.list.d/debian.sources
    fi
    ECAN_CHECK_NAMESPACE=1 unshare --mount --pid --fork --net --mount-proc \
        scripts/check-package.sh "${arguments[@]}"
    exit
fi

root=$(mktemp --directory)
trap 'cd / && umount --recursive "$root" && rmdir "$root"' EXIT
mount -t tmpfs -o mode=755 ecan-check "$root"
tar --extract --file="$tar" --directory="$root"
mount --rbind /proc "$root/proc"
mount --rbind /dev "$root/dev"
mount -t tmpfs tmpfs "$root/tmp"
environment=(-i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root
    LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive)
inside() {
    chroot "$root" /usr/bin/env "${environment[@]}" "$@"
}
inside true || fail "programs for $arch do not run here"
! inside sh -c 'command -v cargo || command -v rustc' || fail "the root contains Rust"

# Files, and the contents that name users, groups and settings.
state() {
    (cd "$root" && find . -xdev \( -path ./tmp -o -path ./proc -o -path ./dev -o -path ./run -o -path ./var/log \
        -o -path ./var/lib/dpkg/info -o -path ./var/cache \) -prune -o -print) |
        grep -vE '^\./(etc/(passwd|group|shadow|gshadow|subuid|subgid)-|var/lib/dpkg/.*-old)$' | sort
    (cd "$root" && cat etc/passwd etc/group etc/shadow etc/gshadow)
}

say "installation"
state >"$root/tmp/before"
packages=()
for package in "$directory"/*_"$arch".deb; do
    case $(basename "$package") in
    ecan-lite-wireshark_*) [[ $wireshark ]] || continue ;;
    esac
    cp "$package" "$root/tmp"
    packages+=("/tmp/$(basename "$package")")
done
((${#packages[@]} > 0)) || fail "$directory contains no package for $arch; run scripts/package.sh"
inside dpkg --install "${packages[@]}"
names=()
for package in "${packages[@]}"; do names+=("$(dpkg-deb --field "$root$package" Package)"); done
inside id ecan
triplet=$machine-linux-gnu

say "programs"
inside ecan --ecrt sim scan
inside ecan --ecrt sim scan 2>/dev/null | grep -q ECAN-Lite
inside ecan-sim variants | grep -q .
for file in usr/share/man/man1/ecan-scan.1.gz usr/share/man/man8/ecan-sim.8.gz \
    usr/share/bash-completion/completions/ecan usr/share/zsh/vendor-completions/_ecan \
    usr/share/fish/vendor_completions.d/ecan.fish lib/udev/rules.d/60-ecan-lite.rules; do
    [[ -s $root/$file ]] || fail "/$file is missing"
done
for file in examples/zenoh/* examples/python/*.py examples/grafana/ecan-lite.json; do
    cmp "$file" "$root/usr/share/doc/libecan-lite-dev/$file"
done
[[ -x $root/usr/share/doc/libecan-lite-dev/examples/zenoh/make-certificates.sh ]] ||
    fail "make-certificates.sh cannot be executed"
inside bash -c 'source /usr/share/bash-completion/completions/ecan && complete -p ecan'
if inside ecan scan 2>"$root/tmp/scan"; then fail "ecan scan has found a master here"; fi
grep -F libethercat.so.1 "$root/tmp/scan"

say "programs of C by pkg-config and by CMake"
cp -r capi/tests/consumer "$root/tmp/consumer"
cp capi/tests/stepped_echo.toml "$root/tmp"
# shellcheck disable=SC2016 # expands in the root
inside sh -e -c '
    cd /tmp/consumer
    gcc port.c $(pkg-config --cflags --libs ecan_igh_host) -o by_pkg_config
    gcc port.c $(pkg-config --cflags --libs ecan_igh_host_without_sim) -o without_sim
    cmake -S . -B build >build.log && cmake --build build >>build.log || { cat build.log; exit 1; }'
for program in by_pkg_config build/port_c build/port_cxx build/port_c_static build/protocol_c; do
    inside env ECAN_ECRT=sim:/tmp/stepped_echo.toml "/tmp/consumer/$program"
done
# On this processor scripts/check-c.sh runs it.
if [[ $arch != "$(dpkg --print-architecture)" ]]; then
    say "every function of C"
    cp -r capi/tests/every_function "$root/tmp"
    # shellcheck disable=SC2016 # expands in the root
    inside sh -e -c 'cd /tmp/every_function
        gcc *.c $(pkg-config --cflags --libs ecan_igh_host) -o program && ./program 2>/dev/null'
fi
if inside env ECAN_ECRT=sim /tmp/consumer/without_sim 2>"$root/tmp/without_sim"; then
    fail "the library without the simulator runs it"
fi
grep -F "built without the simulator" "$root/tmp/without_sim"
inside env ECAN_ECRT="/usr/lib/$triplet/ecan-lite/sim/libethercat.so.1" ecan scan

say "service by the command line of its unit"
unit=$root/lib/systemd/system/ecan-serve@.service
grep -x "RestrictAddressFamilies=AF_INET AF_INET6" "$root/usr/share/ecan-lite/systemd/metrics-tcp.conf"
user=$(sed -n 's/^User=//p' "$unit")
command=$(sed -n 's/^ExecStart=//p' "$unit" | sed 's/%i/0/g')
inside sh -c 'ecan config example >/etc/ecan/master0.toml'
inside install -d -o "$user" -g "$user" -m 755 /run/ecan
log=$root/tmp/service.log
# As systemd does: limits of the unit, its user, its folder.
limits=(prlimit --rtprio=90 --memlock=unlimited)
if ! inside "${limits[@]}" true 2>/dev/null; then
    echo "this host denies the real-time limits of the unit; the service runs without them"
    limits=()
fi
# shellcheck disable=SC2086 # words of the command line
chroot "$root" /usr/bin/env "${environment[@]}" RUNTIME_DIRECTORY=/run/ecan ECAN_ECRT=sim \
    "${limits[@]}" setpriv --reuid "$user" --regid "$user" --init-groups $command >"$log" 2>&1 &
service=$!
for ((second = 0; ; ++second)); do
    ! inside ecan --via /run/ecan/master0.sock info --all >"$root/tmp/info" 2>&1 || break
    if ((second >= 60)) || ! kill -0 "$service"; then
        cat "$log" "$root/tmp/info"
        fail "the service does not respond"
    fi
    sleep 1
done
grep -m 1 "^CAN0" "$root/tmp/info"
kill -TERM "$service"
wait "$service" || { cat "$log"; fail "the service ended with status $?"; }
rm "$root/etc/ecan/master0.toml"

if [[ $wireshark ]]; then
    say "Wireshark plug-in"
    inside tshark -G plugins 2>/dev/null | grep ecan_pdo.lua
fi

say "removal"
inside dpkg --purge "${names[@]}"
state >"$root/tmp/after"
diff "$root/tmp/before" "$root/tmp/after" || fail "the packages leave something behind; see the lines above"
say "the packages hold"
