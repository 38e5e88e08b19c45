#!/bin/sh
# Makes a certificate authority and one certificate each for router, publisher, viewer and operator in the folder DIR.
# ADDRESS is how the others reach the router: DNS:router.local or IP:10.0.0.1. Further names become further clients.
#
# make-certificates.sh DIR ADDRESS [NAME...]
#
# Keep ca.key on a machine that is not connected; give each machine its own NAME.pem and NAME.key and ca.pem only.
set -eu
umask 077
[ $# -ge 2 ] || { echo "make-certificates.sh: needs DIR and ADDRESS, for example: certificates IP:10.0.0.1" >&2; exit 2; }
directory=$1
address=$2
shift 2
mkdir -p "$directory"
cd "$directory"

key="-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes"
# shellcheck disable=SC2086 # several words
[ -e ca.key ] || openssl req -x509 $key -days 3650 -subj /CN=ecan-authority -keyout ca.key -out ca.pem

for name in router publisher viewer operator "$@"; do
    [ -e "$name.key" ] && continue
    # shellcheck disable=SC2086 # several words
    openssl req $key -subj "/CN=$name" -keyout "$name.key" -out "$name.csr"
    if [ "$name" = router ]; then usage="serverAuth,clientAuth"; names=$address; else usage=clientAuth; names=DNS:$name; fi
    printf 'subjectAltName=%s\nextendedKeyUsage=%s\n' "$names" "$usage" > "$name.ext"
    openssl x509 -req -in "$name.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days 825 -extfile "$name.ext" \
        -out "$name.pem"
    rm "$name.csr" "$name.ext"
done
