#!/usr/bin/env bash
# Gives a group the rights that a program with an ECAN-Lite needs: to open /dev/EtherCAT*, to run with
# a real-time priority and to lock its memory. Shows first what it would do, and undoes it again.
set -euo pipefail
export LC_ALL=C

usage() {
    cat <<'END'
Usage: setup_host.sh [show|apply|undo] [OPTIONS]

show   prints what apply would write and run, and changes nothing (the default)
apply  writes a udev rule and real-time limits, makes the group if there is none
undo   removes the two files, if they are as apply has written them

Options:
  --group NAME       group that gets the rights (default ethercat)
  --rt-priority N    highest real-time priority of its members, 1 to 98 (default 80)
  --root DIR         a tree to write to in place of /; no commands are run then

Exit status: 0 done; 1 a file is not of this script or was changed since, and stays; 2 wrong use;
3 not permitted.
END
}

fail() { # STATUS MESSAGE
    printf 'setup_host: %s\n' "$2" >&2
    exit "$1"
}

# ---- arguments

command=show group=ethercat priority=80 root=''
case ${1-} in
show | apply | undo)
    command=$1
    shift
    ;;
-h | --help | '' | --*) ;;
*) fail 2 "unknown command \"$1\"; there are show, apply and undo" ;;
esac
while [[ $# -gt 0 ]]; do
    case $1 in
    --group | --rt-priority | --root)
        [[ $# -gt 1 ]] || fail 2 "$1 takes a value"
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
    *) fail 2 "unknown option \"$1\", see --help" ;;
    esac
    shift
done
[[ $group =~ ^[a-z_][a-z0-9_-]{0,31}$ ]] || fail 2 "\"$group\" is no name of a group"
[[ $priority =~ ^[1-9][0-9]?$ && $priority -le 98 ]] ||
    fail 2 "--rt-priority takes 1 to 98, not \"$priority\""
[[ -z $root || -d $root ]] || fail 2 "there is no directory $root"

# ---- what is written

rule=$root/etc/udev/rules.d/99-ecan-ethercat.rules
limits=$root/etc/security/limits.d/99-ecan-realtime.conf

rule_text() {
    cat <<END
# Members of $group may use the EtherCAT masters of this host.
# := since rules of other files would take it back otherwise.
KERNEL=="EtherCAT[0-9]*", GROUP:="$group", MODE:="0660"
END
}

limits_text() {
    cat <<END
# Members of $group may run with real-time priorities and lock their memory.
@$group - rtprio $priority
@$group - memlock unlimited
END
}

# The first line tells whose file it is, and whether it is as it was written.
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
    ours) if [[ $(<"$1") == "$(marked "$2")" ]]; then is_there=' (there already)'; else is_there=' (replaces the one there)'; fi ;;
    foreign) is_there=' (there is another file of this name: apply would stop)' ;;
    changed) is_there=' (was changed by hand: apply would stop)' ;;
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
    printf 'nothing was changed; to do it: sudo %s apply\n' "$0"
}

check_file() { # FILE
    case $(owner "$1") in
    foreign) fail 1 "$1 is there and not of this script; nothing was changed" ;;
    changed) fail 1 "$1 was changed since it was written; nothing was changed" ;;
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
        fail 3 "cannot write $1; run it with sudo"
    printf 'written   %s\n' "$1"
}

reload() {
    if [[ -n $root ]]; then return; fi
    if command -v udevadm >/dev/null; then
        udevadm control --reload && udevadm trigger --subsystem-match=EtherCAT ||
            printf 'udev was not told; it takes the rule when the host starts again\n'
    fi
}

do_apply() {
    # Both before either is written.
    check_file "$rule"
    check_file "$limits"
    if ! has_group; then
        groupadd --system "$group" || fail 3 "cannot make the group $group; run it with sudo"
        printf 'made      group %s\n' "$group"
    fi
    write_file "$rule" "$(rule_text)"
    write_file "$limits" "$(limits_text)"
    reload
    printf 'Add users with: sudo usermod -aG %s USER; it holds from their next login.\n' "$group"
}

do_undo() {
    local file status=0
    for file in "$rule" "$limits"; do
        case $(owner "$file") in
        missing) printf 'not there %s\n' "$file" ;;
        ours)
            rm -- "$file" 2>/dev/null || fail 3 "cannot remove $file; run it with sudo"
            printf 'removed   %s\n' "$file"
            ;;
        foreign)
            printf 'stays     %s: not of this script\n' "$file"
            status=1
            ;;
        changed)
            printf 'stays     %s: changed since it was written, remove it by hand\n' "$file"
            status=1
            ;;
        esac
    done
    reload
    printf 'The group and its members stay; remove it with: sudo groupdel NAME\n'
    exit $status
}

"do_$command"
