#!/usr/bin/env bash
# The paper's ablations on a small network, 192 pixels wide. Every variant starts from the same depth network and trains for
# 600 steps on the same examples; all are evaluated on the same held-out scenes. Uses one thread; start one process for each
# seed. Resumable: run it again.
#
# usage: ablate.sh OUT SEED
set -euo pipefail
usage="usage: ablate.sh OUT SEED"
out=$(realpath -m "${1:?$usage}") seed=${2:?$usage} steps=600 methods=()
bench=$(realpath "${SHARP_BENCH:-$(dirname "$0")/../../target/release/sharp-bench}")
# Paths in the configurations are relative to the root.
cd "$(dirname "$0")/../.."
root=$PWD
mkdir -p "$out"
sed 's/"img_size": 96/"img_size": 48/; s/"internal_resolution": 384/"internal_resolution": 192/' \
    "$root/sharp/mini/mini-384.json" >"$out/stride2.json"
for stride in 4 8; do
    sed "s/\"internal_resolution\"/\"gaussian_stride\": $stride,\n  &/" "$out/stride2.json" >"$out/stride$stride.json"
done

# train CONFIG FOLDER NETWORK.json [KEY=VALUE…]
train() {
    local config=$root/sharp/train/configs/$1.toml folder=$2 keys=() key
    if [ -e "$folder/weights.safetensors" ]; then return; fi
    for key in network.file="\"$3\"" stage1.side=128 stage2.side=128 stage2.steps=0 intervals.validation=0 "${@:4}"; do
        keys+=(--set "$key")
    done
    "$bench" train -q "$config" --out "$folder" --threads 1 "${keys[@]}"
}

# The bundled network's depth, trained on at this resolution.
depth=$out/$seed/depth-network/weights.safetensors
train mini-384-depth "$out/$seed/depth-network" "$out/stride2.json" initial_depth="\"$root/sharp/mini/mini.safetensors\"" \
    stage1.steps=600 stage1.seed="$seed" stage1.schedule.warmup_steps=25

# variant NAME STRIDE [KEY=VALUE…], for the seed $seed; weights of losses that count per pixel follow the resolution
variant() {
    train mini-384 "$out/$seed/$1" "$out/stride$2.json" initial_depth="\"$depth\"" losses.tv=0.1 \
        loss_options.splat_width=192.0 stage1.steps="$steps" stage1.batch=1 stage1.seed="$seed" \
        stage1.schedule.warmup_steps=25 stage2.batch=1 stage2.seed="$seed" intervals.checkpoint=50 "${@:3}"
    methods+=(--method "sharp:label=$1,checkpoint=$out/$seed/$1/weights.safetensors,config=$out/stride$2.json")
}

rows() {
    local table=$1 pair
    shift
    local arguments=()
    for pair in "$@"; do arguments+=(--row "${pair%%=*}=$out/$seed/${results:-run}:${pair#*=}"); done
    "$bench" table -q "$table" "${arguments[@]}" --out "$out/$seed/tables"
}

regularizers=(losses.{tv,grad,delta,splat,scale,scale_gradient}=0)
variant color-alpha 2 losses.percep=0 losses.depth=0 "${regularizers[@]}"
variant depth 2 losses.percep=0 "${regularizers[@]}"
variant percep 2 "${regularizers[@]}"
variant whole 2
variant no-gram 2 loss_options.percep.gram=0
variant no-alignment 2 aligned=false
variant frozen-depth 2 trained.{patch_encoder,image_encoder,encoder_norms,depth_decoder}=false
variant stride4 4
variant stride8 8
# A fifth of the same budget goes to the second stage.
variant self-supervised 2 stage1.steps=$((steps * 4 / 5)) stage2.steps=$((steps - steps * 4 / 5))

"$bench" run -q --dataset held-out:synthetic=world=varied,seed=902000,size=192x192,scenes=50 --limit 50 \
    --method copy "${methods[@]}" --metrics paper --out "$out/$seed/run"
rows ablation_loss "ours: color+alpha=color-alpha" "ours: color+alpha+depth=depth" \
    "ours: color+alpha+depth+percep=percep" "ours: color+alpha+depth+percep+reg=whole"
rows ablation_gram "ours: no=no-gram" "ours: yes=whole"
rows ablation_depth_alignment "ours: no=no-alignment" "ours: yes=whole"
rows ablation_module "ours: no=frozen-depth" "ours: yes=whole"
rows ablation_ssl "ours: no=whole" "ours: yes=self-supervised"
rows ablation_stride "ours: 2x24x24=stride8" "ours: 2x48x48=stride4" "ours: 2x96x96=whole"
# Time to render, alone: nothing else may run.
"$bench" speed -q --dataset held-out:synthetic=world=varied,seed=902000,size=192x192,scenes=3 "${methods[@]:0:8}" --out "$out/$seed/speed"
results=speed rows ablation_loss_render "ours: color+alpha=color-alpha" "ours: color+alpha+depth=depth" \
    "ours: color+alpha+depth+percep=percep" "ours: color+alpha+depth+percep+reg=whole"
# Each ablation's sheet: the same three pairs under its variants.
for sheet in loss=color-alpha,depth,percep,whole gram=no-gram,whole alignment=no-alignment,whole \
    module=frozen-depth,whole ssl=whole,self-supervised stride=stride8,stride4,whole; do
    "$bench" figure ablation "$out/$seed/run" --methods "${sheet#*=}" --count 3 --out "$out/$seed/sheets/${sheet%%=*}"
done
for pair in depth=color-alpha percep=depth whole=percep whole=no-gram whole=no-alignment whole=frozen-depth \
    self-supervised=whole stride4=stride8 whole=stride4; do
    "$bench" compare "$out/$seed/run" --method "${pair#*=}=${pair%%=*}" >"$out/$seed/${pair%%=*}-after-${pair#*=}.txt"
done
