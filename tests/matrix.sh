#!/bin/sh
# Compiles and runs the short program portable.c everywhere it can: compilers, processors, systems,
# languages, switches; with its threads watched, too. Says what ran where, with what result, and what could not; ends in a count.
# Fails if anything fails; what is not to be had here is left out, and said.
#
#   make -C tests matrix            (some minutes)
#   ITN_NO_INSTALL=1                installs nothing: without it, missing cross compilers and
#                                   emulators are installed by apt-get, if that is there and may
#   sh tests/matrix.sh PATTERN      rows whose name matches only
here=$(cd "$(dirname "$0")" && pwd)
scenes=$here/../scenes
only=${1:-.}
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
trap 'exit 1' HUP INT TERM
LC_ALL=C
export LC_ALL
. "$here/check.sh"
left=0
warnings="-Wall -Wextra -Wpedantic -Wshadow -Wsign-conversion -Werror"
program=$here/portable.c

has() { command -v "$1" > /dev/null 2>&1; }
# have COMMAND PACKAGE...: whether a command is there, after installing packages where that may be
have() {
    wanted=$1
    shift
    has "$wanted" && return 0
    [ -z "$ITN_NO_INSTALL" ] && has apt-get && [ "$(id -u)" = 0 ] && [ $# -gt 0 ] || return 1
    [ -n "$updated" ] || apt-get update > "$work/apt" 2>&1
    updated=1
    echo "installing $*"
    DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "$@" \
        >> "$work/apt" 2>&1
    has "$wanted"
}
wanted() { printf '%s\n' "$1" | grep -q -e "$only"; }
say() { printf '%-42s %s\n' "$1" "$2"; }
leave_out() {
    left=$((left + 1))
    say "$1" "left out: $2"
}
fail() { # NAME WHAT: shows the log's end
    failed=$((failed + 1))
    say "$1" "FAILED: $2"
    tail -n 12 "$work/log" | sed 's/^/    /'
}

# run NAME RUNNER: runs a.out, or a.exe, and compares with what the first one made
run() {
    folder=$work/files$((passed + failed))
    mkdir "$folder"
    if ! (cd "$work" && $2 "./$made" out "${folder##*/}" "$near") > "$work/log" 2>&1; then
        fail "$1" "does not run, or finds faults"
        return
    fi
    checks=$(sed -n 's/^portable: \([0-9]*\) passed.*/\1/p' "$work/log" | tail -n 1)
    if [ -z "$base" ]; then
        base=$folder
        mv "$work/out" "$work/base"
        cp "$work/$made" "$work/compare"
        passed=$((passed + 1))
        say "$1" "ran, $checks checks; others are compared with it"
        return
    fi
    if ! "$work/compare" "$work/base" "$work/out" compare > "$work/log" 2>&1; then
        fail "$1" "pictures differ"
        return
    fi
    agreement=$(tail -n 1 "$work/log")
    for file in "$folder"/*; do # none with ITN_NO_STDIO
        [ -f "$file" ] || continue
        if ! cmp "$base/${file##*/}" "$file" > "$work/log" 2>&1; then
            fail "$1" "${file##*/} has other bytes"
            return
        fi
    done
    passed=$((passed + 1))
    say "$1" "ran, $checks checks; $agreement"
}
# build NAME COMMAND...: compiles to a.out, or a.exe
build() {
    name=$1
    shift
    made=a.out
    case $1 in *mingw*) made=a.exe ;; esac
    rm -f "$work/$made"
    "$@" -o "$work/$made" > "$work/log" 2>&1 && return 0
    fail "$name" "does not compile"
    return 1
}
# row NAME RUNNER COMMAND...: all of it. RUNNER "" is this machine, "no" none: compiled only
row() {
    name=$1 runner=$2
    shift 2
    wanted "$name" || [ -z "$base" ] || return 0
    build "$name" "$@" $warnings "$program" -lm || return 0
    case $runner in
    no*)
        passed=$((passed + 1))
        say "$name" "compiled; not run: ${runner#no }"
        ;;
    *) run "$name" "$runner" ;;
    esac
}
cp -r "$scenes" "$work/scenes"
near=scenes

# ---- this machine: compilers, optimisation, lanes ------------------------------------------------

runs() { grep -qs "$1" /proc/cpuinfo; }
row "gcc -O2, C99" "" gcc -std=c99 -O2
[ -n "$base" ] || { echo "matrix: 0 passed, 1 failed: nothing to compare with"; exit 1; }
for cc in gcc clang; do
    has $cc || { leave_out "$cc" "not installed"; continue; }
    case $cc in gcc) cxx=g++ ;; *) cxx=clang++ ;; esac
    [ $cc = gcc ] || row "$cc -O2, C99" "" $cc -std=c99 -O2
    row "$cc -O0, C11" "" $cc -std=c11 -O0
    row "$cc -O2, numbers one by one, C99" "" $cc -std=c99 -O2 -DITN_NO_SIMD
    why="no this processor has no AVX2"
    runs avx2 && why=
    row "$cc -O2 AVX2, threads, C17" "$why" $cc -std=c17 -O2 -mavx2 -mfma -DITN_THREADS -pthread
    why="no this processor has no AVX-512"
    runs avx512dq && why=
    row "$cc -O3 AVX-512, GNU C23" "$why" $cc -std=gnu2x -O3 -march=skylake-avx512 -Wno-pedantic
    row "$cc -O2, unsigned char, static, C2x" "" $cc -std=c2x -O2 -funsigned-char -DITN_STATIC
    row "$cc -O1, threads, ThreadSanitizer" "" $cc -std=c99 -O1 -g1 -fsanitize=thread \
        -DITN_THREADS -pthread
    has $cxx || { leave_out "$cxx" "not installed"; continue; }
    row "$cxx -O2, C++11" "" $cxx -x c++ -std=c++11 -O2
    row "$cxx -O1, static, C++20" "" $cxx -x c++ -std=c++20 -O1 -DITN_STATIC
done

# ---- other processors and systems ----------------------------------------------------------------

cross() { # NAME COMPILER "PACKAGES" RUNNER "PACKAGES" FLAGS...
    name=$1 compiler=$2 packages=$3 runner=$4 needed=$5
    shift 5
    wanted "$name" || return 0
    # shellcheck disable=SC2086
    have "$compiler" $packages || { leave_out "$name" "no $compiler"; return 0; }
    # shellcheck disable=SC2086
    [ -z "$runner" ] || have "$runner" $needed || runner="no there is no $runner"
    row "$name" "$runner" "$compiler" "$@"
}
arm="gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
ibm="gcc-s390x-linux-gnu libc6-dev-s390x-cross"
old="gcc-i686-linux-gnu libc6-dev-i386-cross"
cross "aarch64 (NEON), C99" aarch64-linux-gnu-gcc "$arm" qemu-aarch64 qemu-user \
    -std=c99 -O2 -static
cross "aarch64, threads, contraction, GNU C99" aarch64-linux-gnu-gcc "$arm" qemu-aarch64 qemu-user \
    -std=gnu99 -O2 -static -DITN_THREADS -pthread
cross "s390x (big-endian), C99" s390x-linux-gnu-gcc "$ibm" qemu-s390x qemu-user \
    -std=c99 -O2 -static
cross "i686 (SSE2), C99" i686-linux-gnu-gcc "$old" "" "" \
    -std=c99 -O2 -static -msse2 -mfpmath=sse
cross "i686 (x87), C99" i686-linux-gnu-gcc "$old" "" "" -std=c99 -O2 -static
cross "musl, threads, C99" musl-gcc musl-tools "" "" -std=c99 -O2 -static -DITN_THREADS -pthread
WINEDEBUG=-all WINEPREFIX=$work/wine
export WINEDEBUG WINEPREFIX
cross "Windows, MinGW-w64, threads, C99" x86_64-w64-mingw32-gcc gcc-mingw-w64-x86-64 \
    wine "wine64 wine" -std=c99 -O2 -static -DITN_THREADS
cross "Windows, MinGW-w64, AVX2, C11" x86_64-w64-mingw32-gcc gcc-mingw-w64-x86-64 \
    wine "wine64 wine" -std=c11 -O2 -static -mavx2 -mfma

# ---- every subset of the switches that leave something out ---------------------------------------

bits=0
while [ $bits -lt 16 ]; do
    flags=
    [ $((bits & 1)) = 0 ] || flags="$flags -DITN_NO_FAST"
    [ $((bits & 2)) = 0 ] || flags="$flags -DITN_NO_SIMD"
    [ $((bits & 4)) = 0 ] || flags="$flags -DITN_NO_NET"
    [ $((bits & 8)) = 0 ] || flags="$flags -DITN_NO_STDIO"
    # shellcheck disable=SC2086
    row "switches:${flags:- none}" "" $CC -std=c99 -O1 $flags
    bits=$((bits + 1))
done

# ---- several files -------------------------------------------------------------------------------

parts() { # NAME "COMPILER FLAGS of the code" "COMPILER FLAGS of the caller" FLAGS...
    name=$1 code=$2 caller=$3
    shift 3
    wanted "$name" || return 0
    # shellcheck disable=SC2086
    if ! $code $warnings -c -o "$work/code.o" > "$work/log" 2>&1; then
        fail "$name" "the code does not compile"
    elif build "$name" $caller $warnings -c "$program"; then
        mv "$work/a.out" "$work/caller.o"
        build "$name" "$CC" "$work/caller.o" "$work/code.o" "$@" && run "$name" ""
    fi
}
whole="-DITN_IMPLEMENTATION -x c $here/../itn.h"
for cc in gcc clang; do
    has $cc || continue
    case $cc in gcc) cxx=g++ ;; *) cxx=clang++ ;; esac
    parts "$cc: code and caller in two files" "$cc -std=c99 -O1 $whole" \
        "$cc -std=c99 -O1 -DPORTABLE_APART" -lm
    parts "$cc: ITN_STATIC in two files" \
        "$cc -std=c99 -O1 -DITN_STATIC -DPORTABLE_OTHER -x c $program" \
        "$cc -std=c99 -O1 -DITN_STATIC -DPORTABLE_TWO" -lm
    has $cxx || continue
    parts "$cc: code in C, caller in C++" "$cc -std=c99 -O1 $whole" \
        "$cxx -x c++ -std=c++17 -O1 -DPORTABLE_APART" -lm
done

# ---- languages: the interface alone, and the code, without a warning -----------------------------

printf '#include "%s/../itn.h"\nitn_result nothing(void);\n' "$here" > "$work/api.c"
printf '#define ITN_IMPLEMENTATION\n#include "%s/../itn.h"\n' "$here" > "$work/code.c"
for pair in gcc:c99 gcc:c11 gcc:c17 gcc:c2x g++:c++11 g++:c++14 g++:c++17 g++:c++20 g++:c++23 \
    clang:c99 clang:c11 clang:c17 clang:c2x clang++:c++11 clang++:c++14 clang++:c++17 \
    clang++:c++20 clang++:c++2b; do
    cc=${pair%:*} std=${pair#*:} language=c
    name="$cc -std=$std"
    wanted "$name" && has $cc || continue
    case $cc in *++) language=c++ ;; esac
    if ! $cc -std="$std" -x $language $warnings -Wconversion -Wstrict-aliasing -Wundef -Wcast-qual \
        -fsyntax-only "$work/api.c" > "$work/log" 2>&1; then
        fail "$name" "the interface"
    elif ! $cc -std="$std" -x $language $warnings -fsyntax-only "$work/code.c" \
        > "$work/log" 2>&1; then
        fail "$name" "the code"
    else
        passed=$((passed + 1))
        say "$name" "interface and code, no warning"
    fi
done

[ $left = 0 ] || echo "$left left out, see above"
echo "matrix: $passed passed, $failed failed"
[ $failed = 0 ]
