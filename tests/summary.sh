#!/bin/sh
# Adds up the logs of all suites: prints each one's failures, what it skipped and its count, and last
# the sum.
# A log without a count, or missing, is a failure.
passed=0 failed=0
for log in "$@"; do
    name=$(basename "$log" .log)
    if [ ! -f "$log" ]; then
        echo "$name: did not build"
        failed=$((failed + 1))
        continue
    fi
    grep -E '^FAILED|exit status|ERROR|runtime error|^skipped|left out' "$log" | head -n 40
    line=$(grep -E '[0-9]+ passed, [0-9]+ failed$' "$log" | tail -n 1)
    p=$(printf '%s\n' "$line" | sed -n 's/.*[^0-9]\([0-9][0-9]*\) passed.*/\1/p')
    f=$(printf '%s\n' "$line" | sed -n 's/.*, \([0-9][0-9]*\) failed$/\1/p')
    if [ -z "$p" ] || [ -z "$f" ]; then
        echo "$name: ended without a count"
        tail -n 5 "$log"
        failed=$((failed + 1))
        continue
    fi
    echo "$name: $p passed, $f failed"
    passed=$((passed + p)) failed=$((failed + f))
    if [ "$f" -eq 0 ] && grep -q 'exit status' "$log"; then failed=$((failed + 1)); fi
done
echo "$passed passed, $failed failed"
[ "$failed" -eq 0 ]
