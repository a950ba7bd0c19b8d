#!/bin/sh
# The learning experiment in earnest, for `make -C tests long`: training on several processes, which
# needs an MPI, and a fiftieth of the whole experiment, which takes minutes.
here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
trap '[ -z "$job" ] || kill "$job"; exit 1' HUP INT TERM
job=
LC_ALL=C
export LC_ALL
# leave to run as any user, and more processes than processors, for Open MPI
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1

. "$here/check.sh"
cd "$work" || exit 1

# same_curve A B: losses of every step agree to 1e-4. The sum over processes rounds in another
# order, 6e-8 of it a step, and steps pass that on.
same_curve() {
    paste -d , "$1.csv" "$2.csv" | awk -F , 'NR > 1 {
        for (k = 2; k <= 3; k++) { d = $k - $(k + 3); if (d < 0) d = -d
            if (!(d <= 1e-4 * ($k < 0 ? -$k : $k) + 1e-6)) bad = 1 } }
        END { exit bad || NR < 3 }'
}

# await COMMAND...: until it succeeds, five minutes at most.
await() {
    for _ in $(seq 1500); do
        "$@" && return
        sleep .2
    done
}
differ() { ! cmp -s "$1" "$2"; }

# 1, 2 and 4 processes take the same batches; another seed must be told from the same.
flags="-std=c99 -O3 -march=native"
if command -v mpicc > /dev/null && command -v mpirun > /dev/null; then
    # shellcheck disable=SC2086
    check "compiles with MPI" mpicc $flags -DUSE_MPI "$root/examples/train.c" -o train -lm -lpthread
    # shellcheck disable=SC2086
    check "compile dataset" ${CC:-cc} $flags "$root/examples/dataset.c" -o dataset -lm -lpthread
    check "data" ./dataset make data --fraction 1/300 --noise 1 --spp 8 --scenes "$root/scenes"
    fit="--data data --batch 8 --spp 2 --channels 2 -t 1"
    # shellcheck disable=SC2086
    {
        check "warm start" mpirun -np 1 ./train --model rn $fit --epochs 2 --checkpoint warm.net
        for count in 1 2 4; do
            check "$count processes" mpirun -np $count ./train --model itn $fit --epochs 4 \
                --start warm.net --checkpoint $count.net
        done
        check "another seed" mpirun -np 2 ./train --model itn $fit --epochs 4 --seed 2 \
            --checkpoint other.net
    }
    for count in 2 4; do check "$count processes: the same curve" same_curve 1.net $count.net; done
    refused differ "another seed: the same curve" cmp 1.net.csv other.net.csv
    check "another seed is noticed" eval "! same_curve 1.net other.net"

    # a process dies, the first, which writes the checkpoint at every step, or the last, soon after
    # the start or later: the job ends, says so, and its last checkpoint is whole
    for which in first last first last; do
        cp 2.net before.net
        # shellcheck disable=SC2086
        mpirun -np 2 ./train --model itn $fit --epochs 4000 --save 0 --resume --checkpoint 2.net \
            > killed 2>&1 &
        job=$!
        await differ 2.net before.net
        # the job's children, or those of its only child (as in MPICH), are the processes
        # shellcheck disable=SC2046
        set -- $(ps -o pid= --ppid "$job")
        # shellcheck disable=SC2046
        [ $# -gt 1 ] || set -- $(ps -o pid= --ppid "$1")
        if [ $which = first ]; then victim=$1; else victim=$2; fi
        check "the $which process is killed" kill -9 "$victim"
        wait "$job"
        check "killed: the job fails" test $? -ne 0
        job=
        check "killed: says so" grep -q 'signal 9' killed
        refused differ "killed: after it had saved" cmp 2.net before.net
        check "killed: the checkpoint is whole" ./train --checkpoint 2.net --export whole.net
        steps=$(($(wc -l < 2.net.csv) - 1))
        # shellcheck disable=SC2086
        check "killed: goes on" mpirun -np 2 ./train --model itn $fit --resume --checkpoint 2.net \
            --epochs $((steps / 3 + 2))
    done
else
    failed=$((failed + 1))
    echo "FAILED no MPI: install its compiler and mpirun, as openmpi-bin and libopenmpi-dev have them"
fi

# stopped in the middle and gone on with, wherever that is: the same bits
fit="--model rn --data part --batch 8 --channels 2 --epochs 900"
# shellcheck disable=SC2086
check "compile" ${CC:-cc} $flags "$root/examples/dataset.c" -o dataset -lm -lpthread
# shellcheck disable=SC2086
check "compile" ${CC:-cc} $flags "$root/examples/train.c" -o train -lm -lpthread
check "a part" ./dataset make part --fraction 1/300 --noise 1 --spp 8 --scenes "$root/scenes"
# shellcheck disable=SC2086
{
    check "at once" ./train $fit --checkpoint once.net
    ./train $fit --checkpoint twice.net > stopped 2>&1 &
    job=$!
    await grep -q step stopped
    check "is stopped" kill -INT $job
    wait $job
    check "stopped: says so" test $? -eq 3
    job=
    check "stopped: before its end" test "$(wc -l < twice.net.csv)" -lt "$(wc -l < once.net.csv)"
    refused differ "stopped: another network" cmp once.net twice.net
    check "goes on" ./train $fit --resume --checkpoint twice.net
}
check "stopped: the same bits" cmp once.net twice.net
check "stopped: the same curve" cmp once.net.csv twice.net.csv

# a fiftieth of the experiment, stopped while it makes pictures and while it trains, then gone on
begun=$(date +%s)
experiment="sh $root/examples/experiment.sh --fraction 1/50 -o out"
for there in out/data/train-chain-00.itnd out/done/sheet; do
    setsid $experiment > stopped 2>&1 & # a process group of its own
    job=$!
    await test -e $there
    sleep 2
    check "experiment: is stopped after $there" kill -s TERM -- -$job
    wait $job
    check "experiment: has not ended" test $? -ne 0 -a ! -e out/table1.csv
    await eval "! kill -s 0 -- -$job 2> stopped" # what it started still saves
    job=
done
$experiment > told 2>&1
check "experiment" test $? -eq 0
echo "learning: the experiment took $(($(date +%s) - begun)) s"
check "experiment: at once" out/train --model rn --data out/data --epochs 40 --rate 1e-3 --bend 12 \
    --units coordinates --batch 8 --channels 4 --spp 8 --seed 1 --checkpoint once.warm
check "experiment: the same bits as stopped" cmp once.warm out/warm.net
check "experiment: a row per model and split" \
    test "$(grep -c '^[a-z]*,[a-z]*,[0-9.e,-]*$' out/table1.csv)" -eq 16
check "experiment: searches" grep -q '^itn,lm,' out/table3.csv
# what must hold even so: training brings the supervised loss down, of every network
for net in rn ssn itn; do
    # shellcheck disable=SC2016
    check "experiment: $net learns" awk -F , 'NR > 1 { if (NR < 12) first += $2; l[NR] = $2 }
        END { for (i = NR - 9; i <= NR; i++) last += l[i]; exit !(last < .8 * first) }' \
        out/$net.net.csv
done

# what lambda is for: in the epoch that follows its choice, of 18 steps, the terms are alike, but
# for noise, of which the choice tells how much it is. alike FACTOR NAME: with so many times lambda
alike() {
    awk -F '[ ,:]+' -v factor="$1" -v name="$2" '
        FILENAME == "told" && $1 == name && /of which noise/ { noise = $12; lambda = $14 }
        FILENAME != "told" && FNR > 865 && FNR <= 883 { parameters += $2; image += $3 - noise }
        END { ratio = factor * lambda * image / parameters; print name, lambda, ratio
            exit !(ratio > .5 && ratio < 2) }' told "out/own-$2.net.csv"
}
for net in ssn itn; do
    check "experiment: terms of $net are alike" alike 1 $net
    check "experiment: another lambda of $net" eval "! alike 5 $net && ! alike .2 $net"
done

# two of the six shapes left out: 96 of the 144 pictures are learnt from, the others are the test
fit="--data out/data --batch 8"
# shellcheck disable=SC2086
{
    check "leave" out/train --model rn $fit --epochs 1 --channels 2 --leave cube,chain \
        --checkpoint left.net
    check "leave: twelve steps" test "$(wc -l < left.net.csv)" -eq 13
    check "leave: go on" out/train --model rn $fit --epochs 2 --resume --checkpoint left.net
    check "leave: still without them" test "$(wc -l < left.net.csv)" -eq 25
    check "leave: evaluate" out/train --model rn $fit --spp 2 --images 4 --checkpoint left.net \
        --evaluate
    refused 'training shapes' "leave: no such shape" out/train --model rn $fit --leave cube,blob \
        --checkpoint none.net
    refused 'other shapes' "leave: a start that was shown them" out/train --model rn $fit \
        --leave cube --start left.net --checkpoint none.net
}
check "leave: rows" test "$(cut -d , -f 2 left.net.table.csv | tr '\n' ' ')" = "split train left "
# of 24 pictures each those that show no variant
check "leave: the shapes left" test "$(awk -F , '$1 == "left" { print $2 }' left.net.answers.csv |
    sort | uniq -c | tr -s ' \n' ' ')" = " 7 chain 12 cube "
echo "learning: $passed passed, $failed failed"
[ "$failed" -eq 0 ]
