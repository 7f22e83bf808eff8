#!/usr/bin/env bash
# Predicts the pairs of smoke/pairs.csv, scores them, and judges the scores by smoke/baseline.zip. Exit codes are those
# of `sharp-bench gate`.
#
# usage: ci/evaluate.sh OUT
set -euo pipefail
cd "$(dirname "$0")/.."
out=$1
dataset='smoke:synthetic=size=96x72,views=10,scenes=10'

sharp-bench pairs export --pairs smoke/pairs.csv --dataset "$dataset" --out "$out/inputs"
python3 predict.py "$out/inputs" "$out/predictions"
# Exit code 4: a prediction is missing or cannot be scored. The gate says what that means.
sharp-bench run --dataset "$dataset" --pairs smoke/pairs.csv --metrics psnr,ssim,lpips \
    --method "imported:label=model,dir=$out/predictions" --out "$out/run" || [ $? -eq 4 ]
sharp-bench gate --baseline smoke/baseline.zip --candidate "$out/run" --config gate.toml \
    --junit "$out/gate.xml" --markdown "$out/comment.md"
