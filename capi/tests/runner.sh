#!/bin/sh
# Runs a test program, under the command of ECAN_TEST_RUNNER if there is one.
# shellcheck disable=SC2086 # words
exec ${ECAN_TEST_RUNNER:-} "$@"
