#!/bin/sh
# Ten materials found again from pictures of them: shipped shapes, as far as 64 x 64 pixels tell them,
# from a start that is off by a factor of three in sigma_t and by .3 in albedo and g. Each search
# takes a minute, or so many seconds as the environment says: RECOVER_SECONDS=10.
#
#   make -C tests recover         writes tests/tables/recovery.csv and prints medians; half an hour
#   sh tests/recover.sh DIR       writes DIR/recovery.csv
#
# Columns: what is hidden and what was found, with standard errors; whether the picture determines
# all three; steps that were taken, and seconds of the whole search on so many cores.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
out=$(cd "${1:-$here/tables}" && pwd)/recovery.csv
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT HUP INT TERM
LC_ALL=C
export LC_ALL
cores=$(getconf _NPROCESSORS_ONLN)
cd "$work"
ln -s "$root/scenes" scenes # paths in scene files have no blanks
for program in render invert; do
    ${CC:-cc} -std=c99 -O3 -march=native "$root/examples/$program.c" -o "$program" -lm -lpthread
done

seconds=${RECOVER_SECONDS:-60}

# scene SHAPE LIGHT ALPHA SIGMA_T ALBEDO G: alpha "none" is an index-matched object
scene() {
    echo "film width 64 height 64"
    echo "camera eye 0.4 0.6 2.2 target 0 0 0 fov 28"
    surface=
    if [ "$3" != none ]; then
        echo "surface glass type dielectric ior 1.5 alpha $3"
        surface="surface glass"
    fi
    echo "medium milk sigma_t $4 albedo $5 g $6"
    echo "object mesh scenes/shapes/$1.ply medium milk $surface"
    case $2 in
        sun) echo "light sky scenes/t3-e60.sky sun 0.42 0.866 -0.27 sun_scale 2" \
                  "sun_radius_scale 20" ;;
        *) echo "light map scenes/maps/$2.exr" ;;
    esac
}

# recover NUMBER SHAPE LIGHT ALPHA SIGMA_T ALBEDO G: one row
recover() {
    scene "$2" "$3" "$4" "$5" "$6" "$7" > truth.itn
    start=$(awk "BEGIN { print $5 * ($1 % 2 ? 3 : 1 / 3), $6 - .3, $7 + ($7 > .35 ? -.3 : .3) }")
    # shellcheck disable=SC2086
    scene "$2" "$3" "$4" $start > start.itn
    ./render truth.itn -o target.exr --spp 16384 --seed 99 -q > /dev/null
    begin=$(date +%s)
    ./invert start.itn --target target.exr --spp 24 --final-spp 100000 --seconds "$seconds" \
        > log || grep -q '^misfit ' log # it says so where the scene explains no picture
    awk -v row="$2,$3,$4,$5,$6,$7" -v seconds=$(($(date +%s) - begin)) -v cores="$cores" '
        $2 == "misfit" { steps = $1 }
        $3 == "+-" && NF == 4 { found = found "," $2 "," $4 }
        /hardly determines/ { told = "no" }
        END { print row found "," (told ? told : "yes") "," steps "," seconds "," cores }' log
}

{
    echo "shape,light,alpha,sigma_t,albedo,g,found_sigma_t,error_sigma_t,found_albedo,error_albedo,\
found_g,error_g,determined,steps,seconds,cores"
    recover 0 figurine sun none 40 .9 .5
    recover 1 chain sun none 25 .8 .7
    recover 2 hound sun none 60 .95 .3
    recover 3 gear studio none 30 .97 .2
    recover 4 star sun none 54 .87 .4
    recover 5 leaf sun none 100 .9 .6
    recover 6 knot studio .1 20 .85 .4
    recover 7 vase sun none 40 .9 .6
    recover 8 blob studio none 8 .95 .7
    recover 9 cube sun none 10 .7 .1
    touch "$work/complete"
} | tee "$work/table"
[ -e "$work/complete" ] || { echo "recover: a search failed; $out is as it was" >&2; exit 1; }
cp "$work/table" "$out.new"
mv "$out.new" "$out"

# medians over the rows that are determined: median COLUMN LABEL, of |found - hidden|, relative for 1
median() {
    awk -F , -v k="$1" 'NR > 1 && $13 == "yes" { d = $(5 + 2 * k) - $(3 + k)
        if (k == 1) d = log($(5 + 2 * k) / $(3 + k))
        print d < 0 ? -d : d }' "$out" | sort -g |
        awk -v label="$2" '{ a[NR] = $1 }
            END { middle = (a[int((NR + 1) / 2)] + a[int(NR / 2) + 1]) / 2
                print "median of |" label "| over " NR ": " middle }'
}
median 1 "d log sigma_t"
median 2 "d albedo"
median 3 "d g"
