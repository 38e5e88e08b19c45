#!/bin/bash
# socketcan-test.sh [ECAN]: can-utils, ISO-TP and Python on `ecan bridge --socketcan`, on the simulator.
# Needs root, vcan, can-isotp and can-utils; ECAN_PYTHON names a Python with python-can and canopen.
# BRIDGE_OPTIONS are further options of the bridge, for example --driver gs-usb. With VIA=1 the bridge works
# through `ecan serve`. It creates the interfaces et00 to et03 and prints what it measures. Status 0:
# passed, or skipped.
set -eu
ecan=${1:-target/debug/ecan}
python=${ECAN_PYTHON:-python3}
count=${COUNT:-2000}
options=${BRIDGE_OPTIONS:-}
work=$(mktemp -d)
bridge='' serve=''
stop() {
    for pid in $bridge $serve; do
        kill "$pid" 2>/dev/null || true
        wait "$pid" || true
    done
    bridge='' serve=''
}
trap 'stop; rm -rf "$work"' EXIT
skip() { echo "skipped: $*"; exit 0; }
fail() { echo "FAILED: $*"; cat "$work/errors"; exit 1; }

for program in candump cansend cangen isotpsend isotprecv; do
    command -v "$program" >/dev/null || skip "no $program (can-utils)"
done
[ "$(id -u)" = 0 ] || skip "not root"
modprobe -aq vcan can-raw can-isotp vhci-hcd gs_usb || true
ip link add dev et00 type vcan 2>"$work/errors" || skip "no vcan: $(cat "$work/errors")"
ip link delete et00

rates='--bitrate 1000000 --data-bitrate 5000000'
# Starts the bridge on all channels of a simulated bus, and waits for the interfaces.
# shellcheck disable=SC2086 # several options
start() {
    set -- --ecrt "sim$1"
    if [ -n "${VIA:-}" ]; then
        "$ecan" "$@" serve --socket "$work/bus.sock" $rates 2>"$work/serve" &
        serve=$!
        until grep -q 'slave 0: ready' "$work/serve"; do
            kill -0 "$serve" 2>/dev/null || fail "ecan serve has ended: $(cat "$work/serve")"
            sleep 0.1
        done
        set -- --via "$work/bus.sock"
    fi
    "$ecan" "$@" bridge --channel all --socketcan 'et%g%c' $rates $options \
        >"$work/addresses" 2>"$work/errors" &
    bridge=$!
    until [ "$(grep -c '^socketcan bridge at et0' "$work/addresses")" = 4 ]; do
        kill -0 "$bridge" 2>/dev/null || fail "the bridge has ended"
        sleep 0.1
    done
}
# wait_for FILE LINES: until a program has written them.
wait_for() {
    for _ in $(seq 600); do
        [ "$(wc -l <"$1")" -ge "$2" ] && return
        sleep 0.1
    done
    fail "$1 has $(wc -l <"$1") of $2 lines"
}

# Two buses of two channels each: what one interface sends, its partner receives.
printf '[[gateway]]\nbuses = ["0.0", "0.0", "0.2", "0.2"]\n' >"$work/pairs.toml"
start ":$work/pairs.toml"
candump -L -n 4 et01 >"$work/dump" &
dump=$!
sleep 0.5
cansend et00 123#1122
cansend et00 12345678#AABBCC
cansend et00 7FF#R
cansend et00 124##1112233445566778899AABBCC
wait "$dump"
sed 's/^.* //' "$work/dump" >"$work/frames"
# Flags 5: bit rate switch and, as drivers set it, CAN FD.
printf '%s\n' 123#1122 12345678#AABBCC 7FF#R 124##5112233445566778899AABBCC | cmp - "$work/frames" ||
    fail "et01 received $(cat "$work/frames")"
echo "candump, cansend: 4 of 4 frames, CAN FD included"

# The data that cangen counts up, in little endian.
for ((number = 0; number < count; number++)); do
    printf '%02X%02X000000000000\n' $((number & 255)) $((number >> 8))
done >"$work/counted"
dumps='' gens=''
for channel in 0 1 2 3; do
    peer=$((channel ^ 1))
    candump -L -n "$count" "et0$peer,10$channel:7FF" >"$work/gen$channel" &
    dumps="$dumps $!"
done
sleep 0.5
begin=$(date +%s.%N)
for channel in 0 1 2 3; do
    cangen "et0$channel" -g 0 -p 10 -n "$count" -I "10$channel" -L 8 -D i &
    gens="$gens $!"
done
for pid in $gens; do wait "$pid"; done
for channel in 0 1 2 3; do wait_for "$work/gen$channel" "$count"; done
end=$(date +%s.%N)
for pid in $dumps; do wait "$pid"; done
for channel in 0 1 2 3; do
    sed 's/^.*#//' "$work/gen$channel" | cmp - "$work/counted" || fail "frames lost, doubled or reordered"
done
echo "cangen: 4 x $count frames at once, in order, none lost, $(awk -v a="$begin" -v b="$end" -v n="$count" \
    'BEGIN { printf "%.0f frames/s", 4 * n / (b - a) }')"

for from in 0 2; do
    set -- "$from" "$((from + 1))"
    isotprecv -s 321 -d 123 "et0$2" >"$work/isotp$1" &
    sleep 0.5
    seq -f '%02.0f' -s ' ' 10 99 | isotpsend -s 123 -d 321 "et0$1"
    wait_for "$work/isotp$1" 1
    seq -f '%02.0f' -s ' ' 10 99 | tr '[:lower:]' '[:upper:]' | cmp - <(tr -d '\n' <"$work/isotp$1" | sed 's/ *$//; s/$/\n/') ||
        fail "isotp"
done
echo "isotpsend, isotprecv: 2 x 90 bytes"
stop
for _ in $(seq 50); do
    if ! ip -br link | grep -q '^et0'; then break; fi
    sleep 0.1
done
if ip -br link | grep '^et0'; then fail "the interfaces remain"; fi
if grep '^#' "$work/errors"; then fail "losses"; fi

# Drives on all channels: error frames and CANopen. A service starts later.
off_ms=${VIA:+30000}
printf '[[gateway]]\n[[node]]\nkind = "silent"\nbus = "0.0"\n[[fault]]\nat_ms = %s\nkind = "bus_off"\ngateway = 0\nchannel = 0\n' \
    "${off_ms:-9000}" >"$work/off.toml"
start ":$work/off.toml"
timeout 120 candump -e -n 2 et00,0~0,#FFFFFFFF >"$work/errors-seen" || fail "no error frames"
for event in 'bus-off' 'restarted-after-bus-off'; do
    grep -q "$event" "$work/errors-seen" || fail "$(cat "$work/errors-seen")"
done
echo "candump -e: $(grep -c ERRORFRAME "$work/errors-seen") error frames: bus-off, restarted-after-bus-off"
stop

"$python" -c 'import can, canopen' 2>/dev/null || skip "$python has no python-can and canopen"
start :drives
"$python" -B "$(dirname "$0")/../tools/ecan/tests/cli/python/canopen_sdo.py" et00 et01 et02 et03
stop
if grep '^#' "$work/errors"; then fail "losses"; fi
