#!/bin/sh
# Succeeds if a program exits with a status: expect_status.sh STATUS PROGRAM [ARGUMENT]...
expected=$1
shift
"$@"
status=$?
if [ "$status" -ne "$expected" ]; then
    echo "exit status $status, expected $expected" >&2
    exit 1
fi
