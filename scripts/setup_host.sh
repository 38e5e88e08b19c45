#!/usr/bin/env bash
# Gives a group the rights for programs that use an ECAN-Lite: open /dev/EtherCAT*, limit the sleep
# states of the processor, real-time priority, locked memory. Shows the changes first, and can undo them.
set -euo pipefail
export LC_ALL=C

usage() {
    cat <<'END'
Usage: setup_host.sh [show|apply|undo] [OPTIONS]

show   prints what apply would write and run, without changes (default)
apply  writes a udev rule and real-time limits, creates the group if it does not exist
undo   removes the two files, if they were not modified

Options:
  --group NAME       group that gets the rights (default that of the package ecan-lite, ecan, if it is
                     installed, else ethercat)
  --rt-priority N    highest real-time priority of its members, 1 to 98 (default 80)
  --root DIR         write below this directory instead of /, and run no commands

Exit status: 0 success; 1 a file of others or a modified file was kept; 2 invalid arguments;
3 no permission.
END
}

fail() { # STATUS MESSAGE
    printf 'setup_host: %s\n' "$2" >&2
    exit "$1"
}

# ---- arguments

command=show group='' priority=80 root=''
case ${1-} in
show | apply | undo)
    command=$1
    shift
    ;;
-h | --help | '' | --*) ;;
*) fail 2 "unknown command \"$1\"; allowed: show, apply and undo" ;;
esac
while [[ $# -gt 0 ]]; do
    case $1 in
    --group | --rt-priority | --root)
        [[ $# -gt 1 ]] || fail 2 "$1 needs a value"
        case $1 in
        --group) group=$2 ;;
        --rt-priority) priority=$2 ;;
        --root) root=${2%/} ;;
        esac
        shift
        ;;
    -h | --help)
        usage
        exit 0
        ;;
    *) fail 2 "unknown option \"$1\"; see --help" ;;
    esac
    shift
done
if [[ ! $group ]]; then
    # Of two rules for the device only one can have effect.
    group=ethercat
    [[ ! -e $root/lib/udev/rules.d/60-ecan-lite.rules ]] || group=ecan
fi
[[ $group =~ ^[a-z_][a-z0-9_-]{0,31}$ ]] || fail 2 "invalid group name \"$group\""
[[ $priority =~ ^[1-9][0-9]?$ && $priority -le 98 ]] ||
    fail 2 "--rt-priority $priority is out of range; allowed: 1 to 98"
[[ -z $root || -d $root ]] || fail 2 "directory $root does not exist"

# ---- files

rule=$root/etc/udev/rules.d/99-ecan-ethercat.rules
limits=$root/etc/security/limits.d/99-ecan-realtime.conf

rule_text() {
    cat <<END
# Members of $group may use the EtherCAT masters of this host.
# := so that rules in other files cannot override it.
KERNEL=="EtherCAT[0-9]*", GROUP:="$group", MODE:="0660"
# They may limit the time that a processor needs to wake up.
KERNEL=="cpu_dma_latency", GROUP:="$group", MODE:="0660"
END
}

limits_text() {
    cat <<END
# Members of $group may run with real-time priorities and lock their memory.
@$group - rtprio $priority
@$group - memlock unlimited
END
}

# The first line identifies the file and contains its checksum.
marked() { # TEXT
    local sum
    sum=$(printf '%s\n' "$1" | cksum)
    printf '# Written by setup_host.sh of ECAN-Lite, remove with setup_host.sh undo. Sum %s\n%s\n' \
        "${sum%% *}" "$1"
}

# Prints missing, ours, changed or foreign.
owner() { # FILE
    local first sum
    if [[ ! -e $1 && ! -L $1 ]]; then
        echo missing
        return
    fi
    first=$(head -n 1 -- "$1")
    if [[ $first != '# Written by setup_host.sh of ECAN-Lite'* ]]; then
        echo foreign
        return
    fi
    sum=$(tail -n +2 -- "$1" | cksum)
    if [[ ${first##*Sum } == "${sum%% *}" ]]; then echo ours; else echo changed; fi
}

has_group() {
    [[ -n $root ]] || getent group "$group" >/dev/null
}

# ---- the commands

show_file() { # FILE TEXT
    local is_there=''
    case $(owner "$1") in
    ours) if [[ $(<"$1") == "$(marked "$2")" ]]; then is_there=' (unchanged)'; else is_there=' (replaces the existing file)'; fi ;;
    foreign) is_there=' (another file exists: apply would fail)' ;;
    changed) is_there=' (modified manually: apply would fail)' ;;
    esac
    printf 'file %s%s:\n' "$1" "$is_there"
    marked "$2" | sed 's/^/    /'
}

do_show() {
    show_file "$rule" "$(rule_text)"
    show_file "$limits" "$(limits_text)"
    if [[ -n $root ]]; then return; fi
    printf 'commands:\n'
    has_group || printf '    groupadd --system %s\n' "$group"
    printf '    udevadm control --reload\n    udevadm trigger --subsystem-match=EtherCAT\n'
    printf '    udevadm trigger --sysname-match=cpu_dma_latency\n'
    printf 'nothing was changed; to apply: sudo %s apply\n' "$0"
}

check_file() { # FILE
    case $(owner "$1") in
    foreign) fail 1 "$1 exists and was not written by this script; nothing was changed" ;;
    changed) fail 1 "$1 was modified after this script wrote it; nothing was changed" ;;
    esac
}

write_file() { # FILE TEXT
    local text
    text=$(marked "$2")
    if [[ -f $1 && $(<"$1") == "$text" ]]; then
        printf 'unchanged %s\n' "$1"
        return
    fi
    { mkdir -p "${1%/*}" && printf '%s\n' "$text" >"$1" && chmod 644 "$1"; } 2>/dev/null ||
        fail 3 "cannot write $1; run with sudo"
    printf 'written   %s\n' "$1"
}

reload() {
    if [[ -n $root ]]; then return; fi
    if command -v udevadm >/dev/null; then
        udevadm control --reload && udevadm trigger --subsystem-match=EtherCAT &&
            udevadm trigger --sysname-match=cpu_dma_latency ||
            printf 'udev not reloaded; the rule takes effect at the next boot\n'
    fi
}

do_apply() {
    # Check both files before writing.
    check_file "$rule"
    check_file "$limits"
    if ! has_group; then
        groupadd --system "$group" || fail 3 "cannot create the group $group; run with sudo"
        printf 'created   group %s\n' "$group"
    fi
    write_file "$rule" "$(rule_text)"
    write_file "$limits" "$(limits_text)"
    reload
    printf 'Add users with: sudo usermod -aG %s USER; it takes effect at their next login.\n' "$group"
}

do_undo() {
    local file status=0
    for file in "$rule" "$limits"; do
        case $(owner "$file") in
        missing) printf 'missing   %s\n' "$file" ;;
        ours)
            rm -- "$file" 2>/dev/null || fail 3 "cannot remove $file; run with sudo"
            printf 'removed   %s\n' "$file"
            ;;
        foreign)
            printf 'kept      %s: not written by this script\n' "$file"
            status=1
            ;;
        changed)
            printf 'kept      %s: modified after this script wrote it; remove it manually\n' "$file"
            status=1
            ;;
        esac
    done
    reload
    printf 'The group and its members are kept; remove it with: sudo groupdel NAME\n'
    exit $status
}

"do_$command"
