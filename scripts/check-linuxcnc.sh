#!/usr/bin/env bash
# Builds the HAL component of examples/linuxcnc, runs its HAL file with LinuxCNC on the simulator, and
# checks motion, holds, a late thread and the end from outside. Debian 12, root, gcc, make.
#
#     scripts/check-linuxcnc.sh PACKAGES [LIBRARIES]
#
# PACKAGES:  folder with the unpacked Debian packages linuxcnc-uspace and linuxcnc-uspace-dev
# LIBRARIES: folder with libecan_igh_host.a and libecan_mcan_host.a [default: target/debug]
set -euo pipefail
cd "$(dirname "$0")/.."
packages=$(cd "$1" && pwd)
libraries=$(cd "${2:-target/debug}" && pwd)
work=$PWD/target/linuxcnc
run=$work/run

# LinuxCNC has fixed paths below /usr and /etc: they are laid over those of the system, in a namespace
# of its own, which also keeps its shared memory and processes apart.
if [ -z "${ECAN_HAL_NAMESPACE:-}" ]; then
    rm -rf "$work"
    mkdir -p "$work/usr/lib/linuxcnc/modules" "$run"
    make --silent -C examples/linuxcnc OUT="$work/usr/lib/linuxcnc/modules" ECAN_CFLAGS=-I../../include \
        LINUXCNC_INCLUDE="$packages/usr/include/linuxcnc" \
        ECAN_LIBS="$libraries/libecan_igh_host.a $libraries/libecan_mcan_host.a -lpthread -ldl"
    cp examples/linuxcnc/{cell.toml,simulated.toml,two_axes.hal,wait_for.sh} "$run"
    # The real-time program drops its rights to this user, who connects to its socket.
    chmod 777 "$run"
    export ECAN_HAL_NAMESPACE=1 RTAPI_UID=65534 RTAPI_FIFO_PATH=$run/rtapi
    # Without a real-time kernel, other programs delay the thread.
    exec nice -n -19 unshare --mount --ipc --pid --fork --mount-proc "$0" "$packages" "$libraries"
fi
mount -t overlay overlay -o "lowerdir=$work/usr:$packages/usr:/usr" /usr
mount -t overlay overlay -o "lowerdir=$packages/etc:/etc" /etc
cd "$run"

fail() {
    echo "check-linuxcnc: $1" >&2
    halcmd show pin ecan-lite >&2 || true
    tail -n 20 "$run"/*.log >&2
    exit 1
}

# Pins by name: `is PIN VALUE`, with the time that it may take.
is() { ./wait_for.sh "ecan-lite.$1" "$2" "${3:-10}" || fail "$1"; }

# The edge counts: a thread that is late would miss a pin that returns before its next period.
enable() {
    halcmd setp "ecan-lite.$1.enable" 0
    is "$1.drv-fault" FALSE
    halcmd setp "ecan-lite.$1.enable" 1
    is "$1.enabled" TRUE
}

echo "-- the HAL file: both axes follow, the PID of HAL closes the loop of one"
halrun -f two_axes.hal >demo.log 2>&1 || fail "halrun -f two_axes.hal"
grep -q "all axes at rest and disabled" demo.log || fail "end of the axes"
# Turns. The lag is the transport time of a target and of the feedback; a wave has an amplitude of 0.5. A
# loaded machine delays the thread at times: one sample in ten may differ by more than 0.03.
awk '
    function size(x) { return x < 0 ? -x : x }
    {
        for (axis = 0; axis < 2; axis++) {
            fb = $(2 * axis + 2); error = size($(2 * axis + 1) - fb)
            if (error > worst[axis]) worst[axis] = error
            late[axis] += error > 0.03
            if (fb > high[axis]) high[axis] = fb
            if (fb < low[axis]) low[axis] = fb
        }
    }
    END {
        printf "%d samples; x: %.3f to %.3f, error %.4f; y: %.3f to %.3f, error %.4f\n",
            NR, low[0], high[0], worst[0], low[1], high[1], worst[1]
        for (axis = 0; axis < 2; axis++)
            if (late[axis] > NR / 10 || size(high[axis] - 0.5) > 0.02 || size(low[axis] + 0.5) > 0.02)
                exit 1
        exit NR != 4000
    }' motion.txt || fail "motion"

# The same without its last lines: the axes continue to move, until one drive reports an over-current.
sed -e '/^loadusr -w sleep/,$d' -e 's/sim:simulated/sim:fault/' two_axes.hal >moving.hal
printf '[[fault]]\nafter_ready_ms = 3000\nkind = "drive_error"\nnode = "x"\ncode = 0x2310\n' |
    cat simulated.toml - >fault.toml
/usr/lib/linuxcnc/realtime start
halcmd -f moving.hal >moving.log 2>&1 || fail "start"

echo "-- a fault of a drive is reported and reset by the next enable, the other axis continues"
is 0.stat-fault TRUE
is 0.drv-fault TRUE
is 0.srv-error-code $((0x2310))
is 1.enabled TRUE
enable 0

echo "-- a command beyond the limits halts the axis, the other one continues"
halcmd unlinkp ecan-lite.0.pos-cmd
halcmd setp ecan-lite.0.pos-cmd 30
is 0.drv-fault TRUE
is 0.rejected TRUE
is 0.stat-op-enabled TRUE
is 1.enabled TRUE
halcmd net x-cmd ecan-lite.0.pos-cmd >/dev/null
enable 0
is 0.rejected FALSE

echo "-- a stopped thread: the drives stop, both axes report it and are enabled again"
process=$(pgrep rtapi_app | head -n 1)
kill -STOP "$process"
sleep 0.6
kill -CONT "$process"
is 0.drv-fault TRUE
is 1.drv-fault TRUE
is 0.hold TRUE
[ "$(halcmd getp ecan-lite.late-cycles)" -gt 0 ] || fail "late cycles are not counted"
enable 0
enable 1

echo "-- disabled by LinuxCNC"
halcmd setp ecan-lite.0.enable 0
is 0.stat-op-enabled FALSE
[ "$(halcmd getp ecan-lite.0.drv-fault)" = FALSE ] || fail "a disabled axis has no fault"

echo "-- another period of the thread is rejected"
halcmd stop
halcmd unload all
grep -q "all axes at rest and disabled" moving.log || fail "end of moving axes"
/usr/lib/linuxcnc/realtime stop
/usr/lib/linuxcnc/realtime start
sed -e 's/period1=1000000/period1=2000000/' -e '/^loadusr/d' moving.hal >period.hal
halcmd -f period.hal >period.log 2>&1 || fail "start"
is period-fault TRUE
is 0.drv-fault TRUE
halcmd stop
halcmd unload all
/usr/lib/linuxcnc/realtime stop
grep -q "thread period 2000000 ns differs from the cycle 1000000 ns" period.log || fail "message"
echo "LinuxCNC: all checks passed"
