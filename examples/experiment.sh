#!/bin/sh
# The learning experiment of Che et al., "Inverse Transport Networks" (2018), from nothing to tables
# 1 to 3 and their figures, with one command. Stopped and started again it goes on where it was.
#
#   sh examples/experiment.sh [--fraction F] [--tests F] [--noise N] [-o DIR] [--data DIR]
#                             [--channels C] [--seed N] [-t THREADS]
#
# F is the part of the 16,400 pictures to make, 1 by default.
# Up to 1/20 it is a trial of everything: noisy pictures, narrow networks, few searches. Its tables
# show that all works, not who wins: 1/50, which takes 9 minutes on two cores, has but 144 training
# pictures. Above 1/20 and below 1 it is a reduced experiment, with noisy pictures and 1/24 of the
# paper's tests. --tests is the part of these to make, where all take too long.
# N is the most noise of a picture, .03 by default, .05 where F is below 1.
# C is the width of the networks' first layer: 16 by default, as released, less where F is below 1.
# The shipped network has 6.
# DIR (out/experiment) receives table1.csv (tables 1 and 2), table3.csv, sheet.png, figure.png,
# figure.svg, and per network NAME.net and NAME.net.*; and known.net, with which searches begin, and
# known.net.txt, how well it reads shapes left out (ten minutes of processor time).
# --data is the folder of the pictures, DIR/data by default; what is there is not made again. --seed
# is that of the training, 1 by default. Each run has a DIR of its own; a second one on the same
# pictures tells how much is chance of training:
#   sh examples/experiment.sh --seed 2 --data out/experiment/data -o out/second
set -eu
here=$(cd "$(dirname "$0")" && pwd)
fraction=1
noise=
tests=
out=out/experiment
data=
channels=
seed=1
threads=$(getconf _NPROCESSORS_ONLN)
# needs OPTION VALUE LOWEST HIGHEST: a number, or one over another, in this range
needs() {
    echo "$2" | awk -F/ '!/^[0-9.]+(e-?[0-9]+)?(\/[0-9.]+)?$/ || (NF == 2 && $2 == 0) { exit 1 }
        { x = NF == 2 ? $1 / $2 : $1 + 0; exit !(x >= '"$3"' && x <= '"$4"') }' && return
    echo "experiment: $1 needs a number from $3 to $4"
    exit 1
}
# digits OPTION VALUE: a whole number
digits() {
    case $2 in '' | *[!0-9]* | ??????????*)
        echo "experiment: $1 needs a whole number of at most 9 digits"; exit 1 ;;
    esac
}
while [ $# -gt 0 ]; do
    [ "$1" != --help ] || { sed -n '5,6s/^# *//p' "$0"; exit; }
    [ $# -gt 1 ] || { echo "experiment: $1 needs a value"; exit 1; }
    case $1 in
        --fraction) needs "$1" "$2" 1e-4 1; fraction=$2 ;;
        --noise) needs "$1" "$2" 1e-3 1; noise=$2 ;;
        --tests) needs "$1" "$2" 1e-4 1; tests=$2 ;;
        -o) out=$2 ;;
        --data) data=$2 ;;
        --seed) digits "$1" "$2"; seed=$2 ;;
        --channels) digits "$1" "$2"; needs "$1" "$2" 1 1024; channels=$2 ;;
        -t) digits "$1" "$2"; needs "$1" "$2" 1 256; threads=$2 ;;
        *) echo "experiment: unknown option $1"; exit 1 ;;
    esac
    shift 2
done
data=${data:-$out/data}
mkdir -p "$out/done" "$data"
exec 9> "$out/done/lock" # held until the last of what this script starts has ended
if command -v flock > /dev/null && ! flock -n 9; then
    echo "experiment: a run is still at work in $out"
    exit 1
fi
settings="fraction $fraction tests ${tests:-default} noise ${noise:-default} seed $seed"
settings="$settings data $data channels ${channels:-default} own units"
if [ ! -e "$out/done/data" ]; then
    rm -f "$out/done/compile"
    printf '%s\n' "$settings" > "$out/done/settings"
fi
if [ "$settings" != "$(cat "$out/done/settings" 2>&1)" ]; then
    echo "experiment: $out is of another version or run: $(cat "$out/done/settings" 2>&1)"
    exit 1
fi

up_to() { awk "BEGIN { exit !($fraction <= $1) }"; }
# bend: pixels; the last epochs show shapes that are not bent, in the end at a low rate, which
# averages out what of the answers is chance of the latest pictures
bend=12 warm_rate=1e-3 calm_rate=3e-4 rate=3e-4 last_rate=1e-4 cool_rate=2e-5
if up_to 1/20; then
    picture="--tests ${tests:-$fraction} --noise ${noise:-0.05} --spp 8"
    warm=40 calm=8 more=1 settle=2 cool=1 spp=8
    training="--batch 8 --channels ${channels:-4}"
    trial="--images 8 --spp 2"
    search="--images 1 --iterations 50 --spp 2"
    scenes=16
elif up_to .99; then
    picture="--tests ${tests:-1/24} --noise ${noise:-0.05}"
    warm=80 calm=24 more=2 settle=3 cool=1 rate=2e-4 spp=16
    training="--batch 16 --channels ${channels:-6}"
    trial="--images 24 --spp 2"
    search="--images 1 --iterations 200 --spp 2"
    scenes=64
else
    picture="--tests ${tests:-1} --noise ${noise:-0.03} --spp 4096"
    warm=110 calm=16 more=14 settle=4 cool=2 spp=4
    channels=${channels:-16}
    if [ "$channels" -gt 8 ]; then # wide layers take lower rates, and fewer epochs
        warm=80 warm_rate=3e-4 calm_rate=1e-4 rate=1e-4 last_rate=3e-5 cool_rate=1e-5
    fi
    training="--batch 16 --channels $channels"
    trial="--images 72 --spp 2"
    search="--images 10 --iterations 200 --spp 2"
    scenes=240
fi

# step NAME COMMAND...: runs the command unless it has been done before, and tells how long it took.
step() {
    name=$1
    shift
    [ -e "$out/done/$name" ] && return
    begun=$(date +%s)
    "$@"
    touch "$out/done/$name"
    echo "== $name: $(($(date +%s) - begun)) s"
}
compile() {
    ${CC:-cc} -std=c99 -O3 -march=native -DITN_IMPLEMENTATION -x c -c "$here/../itn.h" \
        -o "$out/itn.o" || return
    for program in dataset known train starts; do
        ${CC:-cc} -std=c99 -O3 -march=native -DITN_APART "$here/$program.c" "$out/itn.o" \
            -o "$out/$program" -lm -lpthread || return
    done
}
# learn NAME MODEL EPOCHS RATE BEND UNITS [START]: a training run; what there is of it is resumed.
# shellcheck disable=SC2086
learn() {
    net=$out/$1.net
    options="--model $2 --epochs $3 --rate $4 --bend $5 --units $6 $training"
    options="$options --spp $spp --seed $seed"
    if [ -e "$net" ]; then set -- --resume
    elif [ -n "${7:-}" ]; then set -- --start "$out/$7.net"
    else set --
    fi
    "$out/train" $options --data "$data" --checkpoint "$net" "$@" -t "$threads"
}
# shellcheck disable=SC2086
try() {
    "$out/train" --model "$1" --data "$data" --checkpoint "$out/$1.net" --evaluate $trial \
        --seed "$seed" -t "$threads"
}

# shellcheck disable=SC2086
make_data() {
    exec 8> "$data/lock" # another run may share them
    if command -v flock > /dev/null && ! flock -n 8; then
        echo "experiment: a run is still making pictures in $data"
        exit 1
    fi
    "$out/dataset" make "$data" --fraction "$fraction" --scenes "$here/../scenes" \
        -t "$threads" $picture
    exec 8>&-
}

begin=$(date +%s)
step compile compile
step data make_data
"$out/dataset" check "$data" || { make_data; "$out/dataset" check "$data"; } # lost or damaged since
step known "$out/known" "$out/known.net" --shapes "$here/../scenes/shapes" \
    --sky "$here/../scenes/t3-e60-grey.sky" --scenes "$scenes" --seed "$seed" -t "$threads"
step sheet "$out/dataset" sheet "$data" "$out/sheet.png"
shared=$((warm + calm)) settled=$((shared + more + settle))
step warm learn warm rn "$warm" "$warm_rate" $bend coordinates
step calm learn calm rn $shared "$calm_rate" $bend coordinates warm
# from one start, so that the models differ in their losses alone
for model in rn ssn itn; do
    step "own-$model" learn "own-$model" "$model" $((shared + more)) "$rate" $bend own calm
    step "settle-$model" learn "settle-$model" "$model" $settled "$last_rate" 0 own "own-$model"
    step "learn-$model" learn "$model" "$model" $((settled + cool)) "$cool_rate" 0 own \
        "settle-$model"
done
for model in truth rn ssn itn; do
    step "try-$model" try "$model"
done
awk 'FNR > 1 || NR == 1' "$out/truth.net.table.csv" "$out/rn.net.table.csv" \
    "$out/ssn.net.table.csv" "$out/itn.net.table.csv" > "$out/table1.csv.tmp"
mv "$out/table1.csv.tmp" "$out/table1.csv"
# shellcheck disable=SC2086
step starts "$out/starts" --data "$data" -o "$out" -t "$threads" $search \
    "$out/rn.net" "$out/ssn.net" "$out/itn.net"
cat "$out/table1.csv" "$out/table3.csv"
echo "experiment: $(($(date +%s) - begin)) s, results in $out"
