#!/bin/sh
# Compiles the header in every way it promises to compile, links callers, looks at the symbols and
# macros it leaves behind, and checks the form of its text. Prints what failed and a count.
#
#   sh tests/switches.sh            subsets of the switches, among which any two of them are on and
#                                   off in all four ways; builds of a few
#   ITN_LONG_TESTS=1                all subsets by every compiler, as C11 too, and all optimised
#                                   builds (minutes)
#   HEADER=path                     another header than ../itn.h
#
# Compilers: gcc, g++, clang, clang++. One that is missing is reported and counted as skipped.
here=$(cd "$(dirname "$0")" && pwd)
HEADER=${HEADER:-$here/../itn.h}
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
trap 'exit 1' HUP INT TERM
cp "$HEADER" "$work/itn.h" || exit 1
cd "$work" || exit 1
LC_ALL=C
export LC_ALL
[ "$ITN_LONG_TESTS" != 0 ] || ITN_LONG_TESTS=

skipped=0
warnings="-Wall -Wextra -Wpedantic -Wshadow -Wsign-conversion -Werror"

. "$here/check.sh"
show=head
# catches NAME COMMAND...: counts a command that must fail, because an error was planted.
catches() {
    planted=$1
    shift
    "$@" >log 2>&1
    status=$?
    if [ $status -ge 1 ] && [ $status -lt 126 ]; then # not by a signal, nor for want of the command
        passed=$((passed + 1))
    else
        failed=$((failed + 1))
        echo "FAILED planted error not caught: $planted: exit status $status"
    fi
}
skip() {
    skipped=$((skipped + 1))
    echo "skipped: $1"
}
has() { command -v "$1" >/dev/null 2>&1; }

# ---- sources ---------------------------------------------------------------------------------------

cat >whole.c <<'END'
#define ITN_IMPLEMENTATION
#include "itn.h"
#include "itn.h"
int main(void) { return itn_result_text(ITN_OK) == NULL; }
END
cat >code.c <<'END'
#define ITN_IMPLEMENTATION
#include "itn.h"
#include "itn.h"
END
cat >override.c <<'END'
#include <stdlib.h>
static void *my_malloc(size_t bytes) { return malloc(bytes); }
static void my_free(void *block) { free(block); }
#define ITN_MALLOC(bytes) my_malloc(bytes)
#define ITN_FREE(block) my_free(block)
#define ITN_IMPLEMENTATION
#include "itn.h"
#include "itn.h"
int main(void) { return itn_result_text(ITN_OK) == NULL; }
END
cat >half_override.c <<'END'
#include <stdlib.h>
#define ITN_MALLOC(bytes) malloc(bytes)
#define ITN_IMPLEMENTATION
#include "itn.h"
int main(void) { return 0; }
END
# a caller of the main parts: a square under a constant light is exactly as bright as it
cat >use.c <<'END'
#include "itn.h"
#include <string.h>
#ifdef OTHER
int other_call(void);
#define MAIN int other_call(void)
#else
#define MAIN int main(void)
#endif
#ifdef TWO
int other_call(void);
#endif
static int render(void) {
    itn_scene_desc desc;
    itn_surface_desc surface;
    itn_object_desc object;
    itn_light_desc light;
    itn_render_options options;
    itn_scene *scene = NULL;
    itn_image image;
    int bad;
    memset(&desc, 0, sizeof desc);
    memset(&surface, 0, sizeof surface);
    memset(&object, 0, sizeof object);
    memset(&light, 0, sizeof light);
    memset(&options, 0, sizeof options);
    memset(&image, 0, sizeof image);
    surface.name = "white", surface.type = ITN_SURFACE_DIFFUSE, surface.reflectance[0] = 1;
    object.surface = "white", object.half_size = 1;
    light.radiance[0] = 1;
    desc.film.width = desc.film.height = 4, options.spp = 4;
    desc.camera.eye.y = 3, desc.camera.eye.x = .1f;
    desc.surfaces = &surface, desc.surface_count = 1;
    desc.objects = &object, desc.object_count = 1;
    desc.lights = &light, desc.light_count = 1;
    if (itn_scene_create(&desc, NULL, &scene, NULL)) return 1;
    bad = itn_render(scene, NULL, &options, NULL, 0, &image, NULL) != ITN_OK;
    bad = bad || !(image.pixels[0] > .999f && image.pixels[0] < 1.001f);
    itn_image_free(&image);
    options.mode = ITN_MODE_FAST; /* without the fast walk, asking for it is refused */
#ifdef ITN_NO_FAST
    bad = bad || itn_render(scene, NULL, &options, NULL, 0, &image, NULL) != ITN_ERROR_UNSUPPORTED;
#endif
    itn_scene_free(scene);
    return bad;
}
MAIN {
#ifdef TWO
    if (other_call()) return 1;
#endif
    return render();
}
END
echo '#include "itn.h"
int main(void) { return 0; }' >api.c
echo '#include "use.c"' >use_twin.c
for name in whole code override half_override api; do cp $name.c $name.cc; done
grep -h '^#include <' itn.h | grep -v -e windows -e '<intrin' -e '<io.h' | sort -u >system.c

# ---- every subset of the switches, every language ---------------------------------------------------

subset() { # bits -> flags and source of a subset
    flags=
    [ $(($1 & 1)) = 0 ] || flags="$flags -DITN_NO_STDIO"
    [ $(($1 & 2)) = 0 ] || flags="$flags -DITN_NO_NET"
    [ $(($1 & 4)) = 0 ] || flags="$flags -DITN_STATIC"
    [ $(($1 & 8)) = 0 ] || flags="$flags -DITN_THREADS"
    source=whole
    [ $(($1 & 16)) = 0 ] || source=override
}
defined="-Dnear= -Dfar= -Dsun=1" # words that windows.h and old systems define away
compilers=
for pair in "gcc c99 c" "gcc c11 c" "g++ c++11 cc" "clang c99 c" "clang c11 c" "clang++ c++11 cc"; do
    set -- $pair
    [ -n "$ITN_LONG_TESTS" ] || [ "$2" != c11 ] || continue
    if ! has "$1"; then
        skip "$1 -std=$2: not installed"
        continue
    fi
    compilers="$compilers $1"
    all="0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31"
    if [ -z "$ITN_LONG_TESTS" ]; then # all pairs by one compiler
        case $1 in
        clang) all="0 15 19 21 26 28" ;;
        clang++) all="0 31" ;;
        *) all="31" ;; # none of them: see the build below
        esac
    fi
    for bits in $all; do
        subset "$bits"
        check "$1 -std=$2$flags $source.$3" "$1" -std="$2" $warnings $flags -fsyntax-only "$source.$3"
    done
    for flags in -DITN_NO_FAST -DITN_NO_SIMD "-DITN_NO_FAST -DITN_NO_SIMD -DITN_STATIC" \
        "-O1 -mavx2 -mfma" "-O1 -march=native"; do
        case $1$ITN_LONG_TESTS$flags in # what is said in C alone, C compilers have seen
        g++-DITN_NO_FAST | clang++-DITN_NO_FAST) continue ;;
        esac
        case $flags in -O1*) # not on every machine
            "$1" $flags -x c -E /dev/null >log 2>&1 || { skip "$1 $flags: not here"; continue; } ;;
        esac
        check "$1 -std=$2 $flags" "$1" -std="$2" $warnings $flags -fsyntax-only "whole.$3"
    done
    check "$1 -std=$2 interface only" "$1" -std="$2" $warnings -fsyntax-only "api.$3"
    [ "$3" = cc ] || check "$1 -std=$2 near, far, sun" "$1" -std="$2" $warnings $defined \
        -fsyntax-only "whole.$3"
    # floats computed as wider numbers; where the flag is known
    if [ "$1" = gcc ] && [ "$2" = c99 ] && gcc -mfpmath=387 -x c -E /dev/null >log 2>&1; then
        check "gcc -std=c99 -mfpmath=387" gcc -std=c99 $warnings -mfpmath=387 -fsyntax-only whole.c
    fi
    catches "half an allocator" "$1" -std="$2" -fsyntax-only "half_override.$3"
    levels="plain native"
    [ "$2" != c11 ] || levels=
    if [ -z "$ITN_LONG_TESTS" ]; then # two builds
        case $1 in gcc | g++) levels=plain ;; *) levels= ;; esac
    fi
    for level in $levels; do
        build_flags=-O2
        [ $level = plain ] || build_flags="-O2 -march=native"
        if [ -z "$ITN_LONG_TESTS" ]; then
            build_flags="-O0" # the suites' object is optimised, as strictly
        fi
        check "$1 -std=$2 $build_flags" "$1" -std="$2" $warnings $build_flags -fno-pie -c "code.$3" \
            -o "code-$1-$level.o"
    done
done
echo 'enum { SIDES = 6 };
double half = 3. / SIDES;' >deprecated.cc
echo 'int near;' >near.cc
for cxx in g++ clang++; do # what later languages deprecate
    has $cxx || continue
    check "$cxx -std=c++20, near, far, sun" $cxx -std=c++20 $warnings $defined -fsyntax-only whole.cc
    catches "a number divided by an enumerator" $cxx -std=c++20 $warnings -fsyntax-only deprecated.cc
    catches "a variable called near" $cxx -Dnear= $warnings -fsyntax-only near.cc
done
CC=
for name in gcc clang cc; do [ -n "$CC" ] || ! has $name || CC=$name; done
CXX=
for name in g++ clang++ c++; do [ -n "$CXX" ] || ! has $name || CXX=$name; done
[ -n "$CC" ] || { echo "no C compiler"; exit 1; }

# ---- linking -----------------------------------------------------------------------------------------

build() { "$CC" -std=c99 $warnings "$@" -lm -lpthread && ./a.out; }
define="-DITN_IMPLEMENTATION -DITN_NO_FAST"
small="$define -DITN_NO_NET -DITN_NO_STDIO" # all that use.c calls
# every function that the interface declares under these switches must be there to link with
declared() {
    "$CC" -std=c99 $1 -E -P api.c | tr '\n' ' ' | tr ';' '\n' |
        sed -n 's/.*extern [^(]*[ *]\(itn_[a-z0-9_]*\)(.*/\1/p' | sort -u >names
    [ "$(wc -l <names)" -ge "$2" ] || { echo "only $(wc -l <names) functions declared"; return 1; }
    {
        echo '#include "itn.h"'
        echo 'typedef void (*function)(void);'
        echo 'extern function table[];'
        echo 'function table[] = {'
        sed 's/.*/    (function)&,/' names
        echo '    0};'
        echo 'int main(void) { return table[0] == 0; }'
    } >table.c
    "$CC" -std=c99 $define $1 table.c -lm -lpthread && ./a.out
}
for flags in "" "-DITN_NO_STDIO" "-DITN_NO_NET" "-DITN_NO_STDIO -DITN_NO_NET"; do
    check "declared but not defined: $flags" declared "$flags" 25
done
object="code-$CC-plain.o" # the whole code, if it is compiled already
[ -f "$object" ] || object="-DITN_IMPLEMENTATION"
# shellcheck disable=SC2086
check "caller runs" build -no-pie $object use.c
check "caller runs, static" build $small -DITN_STATIC use.c
# memory that comes from the caller is not zero
echo '#include <stdlib.h>
#include <string.h>
static void *filled(size_t bytes) {
    void *block = malloc(bytes);
    return block ? memset(block, 0xa5, bytes) : NULL;
}
#define ITN_MALLOC(bytes) filled(bytes)
#define ITN_FREE(block) free(block)
#define ITN_IMPLEMENTATION
#include "use.c"' >filled.c
check "caller runs, memory of its own" build -DITN_NO_FAST -DITN_NO_NET -DITN_NO_STDIO filled.c
# the macro on the command line meets the header in several places of one file
echo '#include "itn.h"
#include "itn.h"
#include "use.c"' >often.c
check "caller runs, threads; macro on the command line, header included three times" \
    build $small -DITN_THREADS often.c
two() { # flags, first compiler and language, second compiler, language and suffix
    "$2" -std="$3" $1 $small -DTWO -c use.c -o one.o &&
        "$4" -std="$5" $6 -DOTHER -c "use_twin.$7" -o two.o &&
        "$4" one.o two.o -lm -lpthread -o two && ./two
}
check "two files" two "" "$CC" c99 "$CC" c99 "" c
check "static in two files" two -DITN_STATIC "$CC" c99 "$CC" c99 "-DITN_STATIC $small" c
catches "the code in two files without ITN_STATIC" two "" "$CC" c99 "$CC" c99 "$small" c
if [ -n "$CXX" ]; then
    sed 's/int other_call(void);/extern "C" int other_call(void);/
        s/define MAIN int other_call/define MAIN extern "C" int other_call/' use.c >use_twin.cc
    check "code in C, caller in C++" two "" "$CC" c99 "$CXX" c++11 "" cc
else
    skip "C++ caller: no compiler"
fi

# ---- symbols and macros --------------------------------------------------------------------------------

public() { nm -g --defined-only "$1" | awk 'NF == 3 { print $3 }' | grep -vx main; }
# templates of the C++ library, _ZSt..., are there unless they are inlined
only_public() { ! public "$1" | grep -v -e '^itn_[a-z0-9]' -e '^_ZSt' ; }
no_private() { ! public "$1" | grep 'itn__'; }
no_data() { ! nm "$1" | grep ' [bBcCdDgGsS] '; }
no_exit() {
    ! nm -u "$1" | grep -Ew 'exit|_exit|abort|printf|puts|putchar|stdout|stderr|rand|srand|__assert_fail|getenv|setlocale|strtok|snprintf|vsnprintf|__snprintf_chk|__vsnprintf_chk|sprintf|strtod|strtof|atof'
}
uses_malloc() { nm -u "$1" | grep -Ew 'malloc|calloc|realloc|free'; }
no_malloc() { ! uses_malloc "$1"; }
if has nm; then
    for object in code-*.o; do
        [ -f "$object" ] || continue
        check "$object: global name without itn_" only_public "$object"
        check "$object: private name that is global" no_private "$object"
        check "$object: writable data" no_data "$object"
        check "$object: exits, prints, or uses hidden state" no_exit "$object"
    done
    echo '#include <stdio.h>
int leak;
int itn__leak(void) { leak++; puts("x"); return 0; }' >bad.c
    "$CC" -fno-pie -O0 -c bad.c -o bad.o
    catches "a global without prefix" only_public bad.o
    catches "a private name that is global" no_private bad.o
    catches "writable data" no_data bad.o
    catches "printing" no_exit bad.o
    cat >arena.c <<'END'
#include <stddef.h>
static void *my_malloc(size_t bytes) { return bytes ? NULL : NULL; }
static void my_free(void *block) { (void)block; }
END
    sed -n '/^#define/,$p' override.c >>arena.c
    "$CC" -std=c99 -DITN_NO_STDIO -c arena.c -o arena.o
    "$CC" -std=c99 -DITN_NO_FAST -c whole.c -o heap.o
    check "ITN_MALLOC and ITN_FREE replace malloc and free" no_malloc arena.o
    catches "malloc without them" no_malloc heap.o
    no_files() { ! nm -u "$1" | grep -Ew 'fopen|fopen64|open|open64|close|read|write|fsync|rename|remove'; }
    check "ITN_NO_STDIO opens no files" no_files arena.o
    catches "files without it" no_files heap.o
    no_stdio() { ! "$CC" -std=c99 "$@" -E arena.c | grep -q '^# .*stdio\.h"'; }
    check "ITN_NO_STDIO goes without stdio.h" no_stdio -DITN_NO_STDIO
    for flags in "-DITN_NO_FAST -DITN_NO_NET"; do
        "$CC" -std=c99 -DITN_STATIC $flags -c whole.c -o static.o
        all_static() { [ -z "$(public static.o)" ]; }
        check "ITN_STATIC leaves no global $flags" all_static
    done
else
    skip "symbols: nm is not installed"
fi
macros() { "$CC" -std=gnu99 -DITN_THREADS -E -dM "$1" | awk '{ sub(/\(.*/, "", $2); print $2 }' | sort -u; }
macros system.c >macros-before
leaks() { # file: macros beyond those of the system's headers and without the prefix
    macros "$1" >macros-after
    ! comm -13 macros-before macros-after | grep -v -e '^ITN_' -e '^itn__'
}
check "macros without ITN_ after the code" leaks whole.c
check "macros without ITN_ after the interface" leaks api.c
echo '#include "itn.h"
#define LEAK 1' >leak.c
catches "a leaking macro" leaks leak.c

# ---- the text ------------------------------------------------------------------------------------------

nothing() { ! grep -n "$@"; }
check "a line is longer than 100 columns" nothing '.\{101\}' itn.h
check "tab" nothing "$(printf '\t')" itn.h
check "blank at the end of a line" nothing ' $' itn.h
check "not ASCII" nothing '[^ -~]' itn.h
check "placeholder left in the text" nothing '^@[A-Z0-9]*@$' itn.h
check "unfinished" nothing -w -e TODO -e FIXME -e XXX itn.h
printf '%0101d\n' 0 >long.h
catches "a long line" nothing '.\{101\}' long.h

# one_version FILE: its first line, its macros and the top of its history name the same version.
one_version() {
    macros=$(awk '$2 ~ /^ITN_VERSION_(MAJOR|MINOR|PATCH)$/ { printf "%s%s", dot, $3; dot = "." }' "$1")
    history=$(awk 'found { print $1; exit } /\[history\]/ { found = 1 }' "$1")
    echo "macros $macros, history $history"
    [ "$macros" = "$history" ] && head -n 1 "$1" | grep -F "version $macros "
}
check "one version" one_version itn.h
sed '1s/version [0-9]*/version 99/' itn.h >aged.h
catches "another version in the first line" one_version aged.h

# tags of the contents list and of the section banners, in order
listed() {
    sed -n '/\[contents\]/,/\[switches\]/p' "$1" | grep '^       ' | grep -o '\[[a-z][a-z0-9-]*\]'
}
banners() { sed -n 's|^/\* ---- \(\[[a-z][a-z0-9-]*\]\) .*[^-] -* \*/$|\1|p' "$1"; }
same_tags() {
    listed "$1" >tags-listed
    banners "$1" >tags-found
    [ -s tags-listed ] || { echo "the contents list is empty"; return 1; }
    diff tags-listed tags-found
}
check "contents list and sections differ" same_tags itn.h
repeated() { banners itn.h | sort | uniq -d >twice; cat twice; [ ! -s twice ]; }
check "section tag twice" repeated
sed 's|^/\* ---- \[net\]|/* ---- [network]|' itn.h >renamed.h
catches "a renamed section" same_tags renamed.h

# lengths of functions: from a line that begins in column 0 and ends in `{` to the next `}` there
lengths() {
    awk '/^[A-Za-z].*[{]$/ || /^[ ]+.*\) [{]$/ && open { if ($0 !~ /^(typedef|struct|enum|union|extern)/) { if (!start) { start = first ? first : NR; name = head } } }
        /^[A-Za-z].*\(/ && !start { first = NR; head = $0; open = 1 }
        /^[}]/ { if (start) print NR - start + 1, start, name; start = 0; first = 0; open = 0 }
        /^[^ ].*;$/ { if (!start) { first = 0; open = 0 } }
        /^ .*;$/ { if (!start) { first = 0; open = 0 } }' "$1" | sort -n
}
lengths itn.h >functions
short_functions() { ! awk '$1 > 80' "$1" | grep . ; }
enough() { [ "$(wc -l <functions)" -gt 150 ] || { echo "found $(wc -l <functions) functions"; return 1; }; }
check "functions are found" enough
check "function of more than 80 lines (lines, where, what)" short_functions functions
quantile() { sed -n "$(($(wc -l <functions) * $1 / 100 + 1))p" functions | cut -d' ' -f1; }
half() { [ "$(quantile 50)" -le 12 ] || { echo "median length $(quantile 50)"; return 1; }; }
most() { [ "$(quantile 90)" -le 50 ] || { echo "length of the 90th percentile $(quantile 90)"; return 1; }; }
check "median length of functions at most 12" half
check "nine in ten functions have at most 50 lines" most
{
    echo 'static int f(void) {'
    awk 'BEGIN { for (i = 0; i < 90; i++) print "    ;" }'
    echo '}'
} >bad.h
lengths bad.h >bad-functions
catches "a long function" short_functions bad-functions

# names of everything at file scope
if has ctags && ctags --version 2>/dev/null | grep -q Universal; then
    ctags -x --language-force=C --kinds-C=defgpstuv --_xformat='%N %K %n %{scopeKind}' itn.h 2>/dev/null |
        awk '$4 == "" || $4 == "-" { print $1, $2, $3 }' >names
    # three functions are the systems': declared here, as strict C99 hides two and windows.h is large
    prefixed() {
        ! grep -v -e '^itn_' -e '^ITN_' -e '^__anon' "$1" |
            grep -v -e ' macro ' -e '^fsync prototype' -e '^fileno prototype' -e '^MoveFileExA prototype'
    }
    check "name at file scope without itn_ (name, kind, line)" prefixed names
    echo 'stray function 1' >bad-names
    catches "a stray name" prefixed bad-names
else
    skip "names at file scope: Universal Ctags is not installed"
fi

functions=$(wc -l <functions)
echo "itn.h: $(wc -l <itn.h | tr -d ' ') lines, $((functions)) functions of median $(quantile 50), 90th percentile $(quantile 90), longest $(tail -n 1 functions | cut -d' ' -f1) lines"
[ $skipped = 0 ] || echo "switches: $skipped skipped, see above"
echo "switches: $passed passed, $failed failed"
[ $failed = 0 ]
