#!/usr/bin/env bash
# The tables of docs/results.md on models that differ in one thing: a part of the network, the supervision, the number
# of scenes or of steps. From nothing to the page:
#
#   bash benchmarks/ablation.sh OBJECTS FOLDER
#
# OBJECTS holds the published objects. FOLDER gets data, runs and rounds; killed, it goes on where it was. The budget of
# a model is SCENES (half packed, half pile), HEAD steps of the head on true grids, STEPS of the whole, ROUNDS of
# each kind of scene with grasps from THRESHOLD on. A ninth and a third of the scenes, and for LONG steps a ninth and
# all of them, tell what more scenes and steps are worth.
set -euo pipefail
cd "$(dirname "$0")/.."
objects=$1 folder=$2
scenes=${SCENES:-960} head=${HEAD:-1500} steps=${STEPS:-800} long=${LONG:-2400} rounds=${ROUNDS:-60}
threshold=${THRESHOLD:-0.8}
results=docs/results/ablation
data=("$folder/data/packed" "$folder/data/pile")
export OMP_NUM_THREADS=1
mkdir -p "$folder" $results/rounds

. benchmarks/two_at_a_time.sh

# train NAME RECIPE STEPS [OPTION ...]
train() {
  local out=$folder/runs/$1
  if [ -f "$out/weights.safetensors" ]; then return; fi
  neugrasp train --recipe "$2" --steps "$3" --data "${data[@]}" --out "$out" --resume "${@:4}" 2> "$folder/$1.log"
}

# play NAME SCENE
play() {
  local out=$folder/rounds/$1_$2
  neugrasp evaluate --scene "$2" --strategy random --rounds "$rounds" --samples 1 --threshold "$threshold" --workers 1 \
    --weights "$folder/runs/$1/weights.safetensors" --objects "$objects" --out "$out" > "$out.log" 2>&1
  cp "$out/metrics.json" "$results/$1_$2.json"
  tar -cJf "$results/rounds/$1_$2.tar.xz" -C "$folder/rounds" "$1_$2/run.json" "$1_$2/rounds"
}

for scene in packed pile; do
  neugrasp generate --scene $scene --num $((scenes / 2)) --seed 7 --samples 1 --targets 4 --objects "$objects" \
    --out "$folder/data/$scene"
done

few=("$((scenes / 9))" "$((scenes / 3))")
two_at_a_time train head head-only "$head"
for count in "${few[@]}"; do two_at_a_time train "head-$count" head-only "$head" --scenes "$count"; done
finish

models=(small tsdf without-backgrounds without-occupancy without-attention)
for recipe in "${models[@]}"; do
  two_at_a_time train $recipe $recipe "$steps" --init "$folder/runs/head/weights.safetensors"
done
for count in "${few[@]}"; do
  two_at_a_time train "small-$count" small "$steps" --init "$folder/runs/head-$count/weights.safetensors" --scenes "$count"
done
two_at_a_time train "small-${few[0]}-$long" small "$long" --init "$folder/runs/head-${few[0]}/weights.safetensors" \
  --scenes "${few[0]}"
two_at_a_time train "small-$scenes-$long" small "$long" --init "$folder/runs/head/weights.safetensors"
finish

mkdir -p "$folder/rounds"
for model in "${models[@]}" "${few[@]/#/small-}" "small-${few[0]}-$long" "small-$scenes-$long"; do
  for scene in packed pile; do two_at_a_time play "$model" $scene; done
done
finish
python tools/results.py
