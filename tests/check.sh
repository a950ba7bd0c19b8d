# What the scripts of the tests share, by `. check.sh`, once $work names a folder of their own.
# Of the output of a command that failed they show the end, or with show=head its beginning.
passed=0 failed=0
CC=${CC:-cc}
native= # what compiles for this machine, where the compiler knows how
! $CC -march=native -x c -E /dev/null > /dev/null 2>&1 || native=-march=native
show=tail

# refused PATTERN NAME COMMAND...: counts a command that must end with exit status 1, not by a signal,
# and say PATTERN.
refused() {
    pattern=$1 checked=$2
    shift 2
    "$@" > "$work/log" 2>&1
    status=$?
    if [ $status -eq 1 ] && grep -q -e "$pattern" "$work/log"; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        echo "FAILED refused: $checked: exit status $status"
        $show -n 12 "$work/log" | sed 's/^/    /'
    fi
}

# check NAME COMMAND...: counts a command that must succeed; its output is shown when it does not.
check() {
    checked=$1
    shift
    if "$@" > "$work/log" 2>&1; then
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        echo "FAILED $checked"
        $show -n 12 "$work/log" | sed 's/^/    /'
    fi
}
