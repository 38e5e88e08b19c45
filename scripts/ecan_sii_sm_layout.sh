#!/usr/bin/env bash
# Checks and fixes the layout of SM2 and SM3 in the SII (EEPROM) of an ECAN-Lite (manual 5.3, 15.7)
# with IgH's command line tool ethercat.
set -euo pipefail
export LC_ALL=C

usage() {
    cat <<'END'
Usage: ecan_sii_sm_layout.sh check        [OPTIONS] [--rescan]
       ecan_sii_sm_layout.sh fix          [OPTIONS] [--backup FILE] [--yes]
       ecan_sii_sm_layout.sh restore FILE [OPTIONS] [--backup FILE] [--yes]

check    checks SM2 and SM3 in the SII against the manual. The master has a copy of the SII from its
         last scan; a later change is visible with --rescan only
fix      fixes SM2, SM3 and the checksum: makes a backup, shows the change, asks, writes, reads back
restore  writes a backup to the SII: makes a backup of the present SII, asks, writes, reads back
Both let the master scan the bus before and after.

Options:
  --ethercat PATH    IgH's tool (default: ethercat on the PATH, else /opt/etherlab/bin/ethercat)
  --master N         master (default 0)
  --position N       position of the slave (default 0)
  --pdo-bytes BYTES  size of SM2 and SM3, a multiple of 128 up to 3072 (default 3072)
  --backup FILE      path of the backup (default: ecan_sii_POSITION_DATE.bin)
  --rescan           let the master scan the bus first; rejected while an application uses it
  --attempts N       number of reads, one per second, during a scan (default 10)
  --yes              do not ask for confirmation
  --force            continue if the slave is not identified as an ECAN-Lite, the checksum is wrong,
                     or the backup is invalid or from another device

Exit status: 0 success; 1 wrong layout, or not fixed; 2 invalid arguments, or not confirmed; 3 the
ethercat tool failed; 4 the SII is incomplete or cannot be evaluated.
END
}

is_explained=false

fail() { # STATUS MESSAGE
    is_explained=true
    printf 'ecan_sii_sm_layout: %s\n' "$2" >&2
    exit "$1"
}

# ---- arguments

number() { # NAME VALUE
    [[ $2 =~ ^(0|[1-9][0-9]{0,5})$ ]] || fail 2 "$1 needs a number, not \"$2\""
}

command=${1-}
case $command in
check | fix) shift ;;
restore)
    shift
    [[ $# -gt 0 && $1 != --* ]] || fail 2 "restore needs the file to write"
    source_file=$1
    shift
    ;;
-h | --help)
    usage
    exit 0
    ;;
'')
    usage >&2
    exit 2
    ;;
*) fail 2 "unknown command \"$command\"; allowed: check, fix and restore FILE" ;;
esac

ethercat='' master=0 position=0 pdo_bytes=3072 backup='' attempts=10 is_confirmed=false is_forced=false
is_rescanned=false
while [[ $# -gt 0 ]]; do
    case $1 in
    --yes) is_confirmed=true ;;
    --force) is_forced=true ;;
    --rescan) is_rescanned=true ;;
    --ethercat | --master | --position | --pdo-bytes | --backup | --attempts)
        [[ $# -gt 1 ]] || fail 2 "$1 needs a value"
        case $1 in
        --ethercat) ethercat=$2 ;;
        --master) number "$1" "$2" && master=$2 ;;
        --position) number "$1" "$2" && position=$2 ;;
        --pdo-bytes) number "$1" "$2" && pdo_bytes=$2 ;;
        --backup) backup=$2 ;;
        --attempts) number "$1" "$2" && attempts=$2 ;;
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
if ((pdo_bytes == 0 || pdo_bytes > 3072 || pdo_bytes % 128 != 0)); then
    fail 2 "--pdo-bytes $pdo_bytes is invalid; allowed: multiples of 128 up to 3072"
fi
if [[ -z $ethercat ]]; then
    ethercat=$(command -v ethercat || echo /opt/etherlab/bin/ethercat)
fi
command -v "$ethercat" >/dev/null || fail 3 "tool $ethercat not found; set --ethercat"

work=$(mktemp -d) || fail 3 'cannot create a temporary directory; set TMPDIR'

# An error of the script itself must not look like a wrong layout. The function `fail` in a command
# substitution reports its own status.
end() {
    local status=$?
    rm -rf "$work"
    if ((status == 1 || status > 4)) && ! $is_explained; then
        printf 'ecan_sii_sm_layout: unexpected end with status %d; the SII was not evaluated\n' "$status" >&2
        exit 4
    fi
}
trap end EXIT

# ---- the tool. Only long options: the meaning of -p depends on the version.

tool() { # COMMAND [ARGUMENT...]: its output
    local status=0
    "$ethercat" "$1" --master "$master" "${@:2}" 2>"$work/errors" || status=$?
    if ((status != 0)); then
        local said
        said=$(grep -m 1 . "$work/errors" || echo "exit status $status")
        fail 3 "ethercat $1: $said"
    fi
}

read_sii() { # FILE
    if $is_rescanned; then
        scan "$1"
    else
        tool sii_read --position "$position" >"$1"
    fi
    [[ -s $1 ]] || fail 4 "ethercat sii_read returned no data; check that the master has scanned slave $position"
}

# Lets the master scan the bus, and reads the SII. During the scan the copy of the master is missing
# or incomplete, so that two equal reads are required.
scan() { # FILE
    local phase
    phase=$(tool master)
    if [[ $phase == *'Phase: Operation'* || $phase == *'Active: yes'* ]]; then
        fail 4 "an application uses the master, so the bus cannot be scanned; stop it and retry"
    fi
    tool rescan
    : >"$1"
    local -i attempt
    for ((attempt = 0; attempt <= attempts; attempt++)); do
        sleep 1
        "$ethercat" sii_read --master "$master" --position "$position" >"$work/again" 2>"$work/errors" ||
            : >"$work/again"
        if [[ -s $1 ]] && cmp -s "$1" "$work/again"; then return; fi
        cp "$work/again" "$1"
    done
    local said
    said=$(grep -m 1 . "$work/errors" || echo "no complete SII of slave $position after $attempts s")
    fail 3 "ethercat sii_read: $said"
}

# ---- the image

declare -ai bytes=()

load() { # FILE
    local numbers
    numbers=$(od -An -v -tu1 "$1")
    # shellcheck disable=SC2206 # one word per byte
    bytes=($numbers)
}

store() { # FILE
    local escapes
    printf -v escapes '\\x%02x' "${bytes[@]}"
    printf '%b' "$escapes" >"$1"
}

word() { # BYTE_OFFSET; result in `value`
    value=$((bytes[$1] | bytes[$1 + 1] << 8))
}

# CRC-8, polynomial 0x07, initial value 0xFF, over the first seven words; result in `value`.
checksum() {
    local -i at bit
    value=255
    for ((at = 0; at < 14; at++)); do
        value=$((value ^ bytes[at]))
        for ((bit = 0; bit < 8; bit++)); do
            value=$((value & 0x80 ? (value << 1 ^ 0x07) & 0xFF : value << 1))
        done
    done
}

readonly REBUILD='let the gateway rebuild its EEPROM (0xB000:04, bit 6, manual 13.7)'
readonly REMEDY="it cannot be fixed here: $REBUILD, or restore a backup"

# Exits with 4 unless the image has categories.
require_categories() {
    local -i count=${#bytes[@]}
    if ((count < 130 || count % 2 != 0)); then
        fail 4 "the SII has $count bytes, too few for categories or an odd number; $REMEDY"
    fi
}

# Stores the byte offset of the sync manager category in `sync_managers`. Exits with 1 if it is
# missing, with 4 if the image ends before.
find_sync_managers() {
    local -i count=${#bytes[@]} at=128 kind words
    require_categories
    while ((at + 1 < count)); do
        word $at && kind=$value
        ((kind == 0xFFFF)) && fail 1 "the SII has no category 41 (sync managers); $REMEDY"
        if ((at + 3 >= count)); then break; fi
        word $((at + 2)) && words=$value
        if ((at + 4 + 2 * words > count)); then
            fail 4 "category $kind at byte $at exceeds the end of the SII; $REMEDY"
        fi
        if ((kind == 41)); then
            ((words >= 16)) ||
                fail 1 "the SII describes only $((words / 4)) of 4 sync managers; $REMEDY"
            sync_managers=$((at + 4))
            return
        fi
        at=$((at + 4 + 2 * words))
    done
    fail 4 "the SII ends after byte $((at - 1)) without category 41 (sync managers) and without end mark; $REMEDY"
}

# ---- expected layout

is_good=true
is_checksum_good=true
changes=()

compare() { # NAME FOUND WANTED FORMAT
    local found wanted
    # shellcheck disable=SC2059 # the formats are ours
    printf -v found "$4" "$2"
    # shellcheck disable=SC2059
    printf -v wanted "$4" "$3"
    if (($2 == $3)); then
        printf 'ok     %-21s %s\n' "$1" "$found"
    else
        printf 'WRONG  %-21s %s, must be %s\n' "$1" "$found" "$wanted"
        is_good=false
        changes+=("$1: $found -> $wanted")
    fi
}

set_word() { # BYTE_OFFSET VALUE
    bytes[$1]=$(($2 & 0xFF))
    bytes[$1 + 1]=$(($2 >> 8))
}

# Compares `bytes` with the manual and fixes them.
judge() {
    local -i number start control kind at
    require_categories
    checksum
    compare "checksum of words 0-6" "${bytes[14]}" "$value" 0x%02X
    if ! $is_good; then is_checksum_good=false; fi
    bytes[14]=$value
    find_sync_managers
    while read -r number start control kind; do
        at=$((sync_managers + 8 * number))
        word $at
        compare "SM$number start" "$value" "$start" 0x%04X
        set_word $at $start
        word $((at + 2))
        compare "SM$number size" "$value" "$pdo_bytes" %d
        set_word $((at + 2)) "$pdo_bytes"
        compare "SM$number control byte" "${bytes[at + 4]}" "$control" 0x%02X
        bytes[at + 4]=$control
        # Not specified in the manual, so not changed.
        if (((bytes[at + 6] & 1) == 0)); then
            printf 'note   SM%d is not enabled by the SII\n' "$number"
        fi
        if ((bytes[at + 7] != kind)); then
            printf 'note   SM%d has type %d, usually %d\n' "$number" "${bytes[at + 7]}" "$kind"
        fi
    done <<<"2 $((0x1100)) $((0x66)) 3
3 $((0x1D00)) $((0x22)) 4"
}

# ---- writing

# Another device would be unusable with this layout.
recognize() {
    $is_forced && return
    local unit header
    unit=$(tool upload --position "$position" --type uint16 0xF000 17)
    header=$(tool upload --position "$position" --type uint16 0xF000 18)
    if [[ ${unit##* } != 128 || ${header##* } != 24 ]]; then
        fail 1 "slave $position is not identified as an ECAN-Lite (0xF000); use --force to write anyway"
    fi
}

# The words covered by the checksum configure the start of the controller. If the checksum is wrong,
# only the user can decide which of the two is damaged.
warn_of_checksum() {
    $is_checksum_good && return
    printf 'words 0-6:'
    local -i at
    for ((at = 0; at < 14; at += 2)); do
        word $at
        printf ' 0x%04X' "$value"
    done
    printf '\nIf these words are damaged and not the checksum, a new checksum makes the damage valid, and\n'
    printf 'the controller may not start: in this case restore a backup, or %s.\n' "$REBUILD"
    if $is_confirmed && ! $is_forced; then
        fail 1 "the checksum is wrong; use --force to write a new one"
    fi
}

reject_in_operation() {
    local state
    state=$(tool slaves --position "$position")
    if [[ $state =~ (^|[[:space:]])OP([[:space:]]|$) ]]; then
        fail 1 "slave $position is in OP; stop the application and retry"
    fi
}

keep_backup() { # FILE
    if [[ -z $backup ]]; then
        backup=ecan_sii_${position}_$(date +%Y%m%d-%H%M%S).bin
    fi
    [[ ! -e $backup ]] || fail 2 "the backup $backup exists and is not overwritten"
    { cp -- "$1" "$backup" && cmp -s -- "$1" "$backup"; } 2>/dev/null ||
        fail 2 "cannot write the backup $backup"
    printf 'backup of the present SII: %s\n' "$backup"
}

confirm() { # QUESTION
    $is_confirmed && return
    [[ -t 0 ]] || fail 2 "cannot ask for confirmation, nothing was written; use --yes"
    local answer
    read -r -p "$1 [y/N] " answer
    [[ $answer == [yY] || $answer == yes ]] || fail 2 "not confirmed, nothing was written"
}

# The master caches the SII from its scan of the bus: without a rescan it returns the old one.
write_sii() { # FILE [--force]
    printf 'writing ...\n'
    tool sii_write "${@:2}" --position "$position" "$1"
    tool rescan
    local -i attempt
    for ((attempt = 1; attempt <= attempts; attempt++)); do
        ((attempt == 1)) || sleep 1
        if "$ethercat" sii_read --master "$master" --position "$position" \
            >"$work/back" 2>"$work/errors" && cmp -s "$1" "$work/back"; then
            printf 'readback matches. Power-cycle the gateway.\n'
            return
        fi
    done
    fail 1 "readback does not match; restart the master and check again; the backup is $backup"
}

# ---- the commands

do_check() {
    read_sii "$work/found"
    load "$work/found"
    printf 'slave %d, SII of %d bytes\n' "$position" "${#bytes[@]}"
    judge
    if ! $is_good; then
        printf 'the layout does not match the manual (15.7); fix it with: %s fix\n' "$0"
    else
        printf 'the layout matches the manual (15.7)\n'
    fi
    if ! $is_rescanned; then
        printf 'note: this is the copy of the last scan of the master; --rescan reads the SII again\n'
    fi
    if ! $is_good; then
        is_explained=true
        exit 1
    fi
}

do_fix() {
    is_rescanned=true
    read_sii "$work/found"
    load "$work/found"
    printf 'slave %d, SII of %d bytes\n' "$position" "${#bytes[@]}"
    judge
    if $is_good; then
        printf 'nothing to fix\n'
        return
    fi
    recognize
    reject_in_operation
    warn_of_checksum
    store "$work/fixed"
    keep_backup "$work/found"
    printf 'to be changed:\n'
    printf '  %s\n' "${changes[@]}"
    confirm "Write the SII of slave $position?"
    write_sii "$work/fixed"
}

# Vendor, product and serial number; not the revision, which may depend on the firmware.
identity() { # FILE
    od -An -v -tx1 -j 16 -N 8 "$1" && od -An -v -tx1 -j 28 -N 4 "$1"
} 2>/dev/null

# Checks that the loaded image is valid and belongs to the slave whose SII is in `found`.
judge_backup() {
    local -a doubts=()
    local said found_bytes
    found_bytes=$(wc -c <"$work/found")
    checksum
    ((value == bytes[14])) || doubts+=("its checksum is wrong")
    if ! said=$(find_sync_managers 2>&1); then
        said=${said#*: }
        # The remedy for a slave does not apply to a file.
        doubts+=("${said%; it cannot be fixed here*}")
    fi
    ((${#bytes[@]} == found_bytes)) ||
        doubts+=("it has ${#bytes[@]} bytes, the SII of the slave $found_bytes")
    [[ $(identity "$source_file") == "$(identity "$work/found")" ]] ||
        doubts+=("its vendor, product or serial number differs from the slave")
    ((${#doubts[@]})) || return 0
    printf '%s: %s\n' "$source_file" "${doubts[0]}"
    if ((${#doubts[@]} > 1)); then printf '  and %s\n' "${doubts[@]:1}"; fi
    $is_forced ||
        fail 1 "$source_file may be damaged or not from slave $position; use --force to write anyway"
}

do_restore() {
    local -a force=()
    [[ -r $source_file && -f $source_file ]] || fail 2 "cannot read $source_file"
    load "$source_file"
    if ((${#bytes[@]} < 130 || ${#bytes[@]} % 2 != 0)); then
        fail 2 "$source_file has ${#bytes[@]} bytes and is not an SII"
    fi
    is_rescanned=true
    read_sii "$work/found"
    if cmp -s -- "$source_file" "$work/found"; then
        printf 'the SII of slave %d already matches %s\n' "$position" "$source_file"
        return
    fi
    judge_backup
    recognize
    reject_in_operation
    keep_backup "$work/found"
    checksum
    # The tool rejects images with a wrong checksum.
    if ((value != bytes[14])); then force=(--force); fi
    confirm "Write $source_file to the SII of slave $position?"
    write_sii "$source_file" "${force[@]}"
}

"do_$command"
