#!/bin/sh
# Waits until a HAL pin has a value: wait_for.sh PIN VALUE SECONDS
end=$(($(date +%s) + $3))
while [ "$(halcmd getp "$1")" != "$2" ]; do
    if [ "$(date +%s)" -gt "$end" ]; then
        echo "wait_for: pin $1 is $(halcmd getp "$1"); expected $2 within $3 s" >&2
        exit 1
    fi
    sleep 0.05
done
