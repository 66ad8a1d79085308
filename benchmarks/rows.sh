#!/usr/bin/env bash
# The rows of docs/results.md, each played or finished, then the page itself:
#
#   bash benchmarks/rows.sh OBJECTS FOLDER [ROW ...]        all rows, or those named
#
# OBJECTS holds the published test objects, FOLDER gets a folder for each row. Rounds that docs/results/rounds has are
# taken from there, so that only missing ones are played; remove a row's archive to play all of it again. Rows of VGN
# need VGN=vgn_conv.pth. Two rows at a time: every round alternates between a renderer and one thread of the network.
set -euo pipefail
cd "$(dirname "$0")/.."
objects=$1 folder=$2
shift 2
wanted=" $* "
results=docs/results
mkdir -p "$folder" "$results/rounds"
. benchmarks/two_at_a_time.sh

play() {
  local name=$1
  shift
  local out=$folder/$name archive=$results/rounds/$name.tar.xz
  if [ ! -d "$out" ] && [ -f "$archive" ]; then tar -xJf "$archive" -C "$folder"; fi
  OMP_NUM_THREADS=1 neugrasp evaluate --workers 1 --objects "$objects" --out "$out" "$@" > "$out.log" 2>&1
  cp "$out/metrics.json" "$results/$name.json"
  tar -cJf "$archive" -C "$folder" "$name/run.json" "$name/rounds"
  echo "$name: $(grep "^SR " "$out.log")"
}

row() {
  if [ "$wanted" = "  " ] || [[ $wanted == *" $1 "* ]]; then
    two_at_a_time play "$@"
  fi
}

photos=(--strategy random --samples 1)
for scene in packed pile; do
  row neugrasp_${scene}_transparent-specular --scene $scene "${photos[@]}"
  row neugrasp_${scene}_diffuse --scene $scene --materials diffuse --rounds 100 "${photos[@]}"
  row neugrasp_${scene}_transparent-specular_top --scene $scene --strategy top --rounds 100 --samples 1
  row neugrasp-tsdf_${scene}_transparent-specular --scene $scene --rounds 60 --weights neugrasp-tsdf "${photos[@]}"
  row neugrasp-evaluator_${scene}_transparent-specular --scene $scene --detector neugrasp-evaluator "${photos[@]}"
  row perfect-judge_$scene --scene $scene --detector perfect-judge --strategy random --rounds 60
  row oracle-evaluator_$scene --scene $scene --detector oracle-evaluator --strategy random --rounds 100
  row oracle_neugrasp_$scene --scene $scene --detector oracle --strategy random
  row antipodal_$scene --scene $scene --detector antipodal
done
row neugrasp_single_transparent-specular --scene single "${photos[@]}"
row neugrasp_packed_transparent-specular_paper --views paper "${photos[@]}"
# Photos with less noise, in fewer rounds: what one sample a pixel costs.
row neugrasp_packed_transparent-specular_4samples --rounds 50 --strategy random
row neugrasp_pile_transparent-specular_4samples --scene pile --rounds 50 --strategy random

if [ -n "${VGN:-}" ]; then
  for scene in packed pile; do
    row oracle_vgn_$scene --scene $scene --detector oracle --weights "$VGN"
    row vgn_$scene --scene $scene --detector vgn --weights "$VGN" --views hemisphere6 --protocol vgn --strategy random
    for materials in transparent-specular diffuse; do
      row vgn_stereo_${scene}_$materials --scene $scene --materials $materials --rounds 40 --detector vgn --weights "$VGN" \
        --depth stereo
    done
  done
fi
finish
python tools/results.py
