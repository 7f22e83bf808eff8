#!/usr/bin/env bash
# Shows that the tests of the renderer catch wrong rules: changes one rule at a time, in the CPU's
# passes and in the shaders, in a copy of the sources, and expects a test to fail. The shaders' half
# needs a Vulkan adapter and is skipped, visibly, without one.
#
# usage: tests/mutants/render.sh [NAME…]      prints a line per mutation; exit 1 if one survives
# MUTANTS_TARGET_DIR: a build folder to keep between runs; MUTANTS_HALVES: cpu, gpu, or both
set -euo pipefail
root=$(git -C "$(dirname "$0")" rev-parse --show-toplevel)
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
git -C "$root" ls-files -z | (cd "$root" && xargs -0 cp --parents -t "$copy")
export CARGO_TARGET_DIR=${MUTANTS_TARGET_DIR:-$copy/target}

# The renderer's tests alone, so that a mutation rebuilds the renderer and not the product.
cat >"$copy/tests/Cargo.toml" <<'TOML'
[package]
name = "sharp-tests"
version.workspace = true
edition.workspace = true
autotests = false
autoexamples = false

[features]
gpu = ["sharp/gpu"]

[dev-dependencies]
glam.workspace = true
libtest-mimic.workspace = true
rayon.workspace = true
safetensors.workspace = true
sharp = { workspace = true, features = ["render"] }

[[test]]
name = "golden_render"

[[test]]
name = "render_properties"

[[test]]
name = "golden_gpu"
harness = false
required-features = ["gpu"]
TOML

# name @ file @ sed expression; for the CPU in sharp/src/render, for the GPU in shaders
cpu=$(cat <<'LIST'
alpha clamped at 0.99 @ rule.rs @ s/alpha_max: 0.999,/alpha_max: 0.99,/
no skip below 1/255 @ raster.rs @ s/let hit = alpha_min.le(alpha);/let hit = zero.le(alpha);/
skip at 2/255 @ raster.rs @ s/(L::splat(ALPHA_MIN), /(L::splat(2.0 * ALPHA_MIN), /
opacity of exactly 1/255 dropped @ project.rs @ s/c.opacity\[i\] < f64::from/c.opacity[i] <= f64::from/
the stopping Gaussian is added @ raster.rs @ s/let adds = left.gt_where(stop, hit);/let adds = left.gt_where(zero, hit);/; s/done.add(transmittance.masked(stops))/done.add(left.masked(stops))/; s/L::select(adds, left, transmittance);/L::select(left.gt_where(stop, hit), left, transmittance);/
transmittance stops at 1e-3 @ raster.rs @ s/TRANSMITTANCE_STOP: f32 = 1e-4;/TRANSMITTANCE_STOP: f32 = 1e-3;/
pixel centres at whole numbers @ raster.rs @ s/as f32 + 0.5$/as f32/
the near plane is strict @ project.rs @ s/c.z\[i\] < constants.near/c.z[i] <= constants.near/
depth keys of 16 bits @ emit.rs @ s/u64::from(z.to_bits()) << 32/u64::from(z.to_bits() >> 16 << 16) << 32/
order by ray length @ project.rs @ s/c.z\[i\] = z as f32;/c.z[i] = (x * x + y * y + z * z).sqrt() as f32;/
ties by descending index @ cpu.rs @ s/radix::sort(&mut scratch.keys/scratch.keys.reverse(); &/
unstable sort @ radix.rs @ s/for key in &\*keys {/for key in keys.iter().rev() {/
tile range one short @ ranges.rs @ s/\[y \* side + x0..y \* side + x1 + 1\]/[y * side + x0..y * side + x1.max(x0)]/; s/\[row + x0..row + x1 + 1\]/[row + x0..row + x1.max(x0)]/
footprint one pixel short @ project.rs @ s/let mut last = (at + reach).floor()/let mut last = (at + reach - 1.0).floor()/
blended in sRGB @ project.rs @ s/None => scene.colors\[k\],/None => scene.colors[k].map(crate::color::srgb_from_linear),/
the Jacobian is not clamped @ project.rs @ s/JACOBIAN_MARGIN: f64 = 0.3;/JACOBIAN_MARGIN: f64 = 30.0;/
the mean is clamped too @ project.rs @ s/k.focal\[0\] \* slope_x + k.center\[0\]/k.focal[0] * slope_x.max(k.bounds[0][0]).min(k.bounds[0][1]) + k.center[0]/
eps2d is always 0.3 @ project.rs @ s/eps2d: f64::from(rule.low_pass)/eps2d: 0.3/
determinant as ac - b² in f32 @ project.rs @ s/let determinant = cross + .*/let determinant = f64::from((uu + k.eps2d) as f32 * (vv + k.eps2d) as f32 - b as f32 * b as f32);/
depth is not weighted by alpha @ raster.rs @ s/depth = weight.mul_add(L::splat(s.z), depth);/depth = transmittance.mul_add(L::splat(s.z), depth);/
LIST
)
gpu=$(cat <<'LIST'
alpha clamped at 0.99 @ raster.wgsl @ s/vec4<f32>(frame.alpha_max)/vec4<f32>(0.99)/
no skip below 1/255 @ raster.wgsl @ s/let hit = alpha >= vec4<f32>(ALPHA_MIN);/let hit = alpha >= vec4<f32>(0.0);/
skip at 2/255 @ raster.wgsl @ s/let hit = alpha >= vec4<f32>(ALPHA_MIN);/let hit = alpha >= vec4<f32>(2.0 * ALPHA_MIN);/
opacity of exactly 1/255 dropped @ project.wgsl @ s/if !(opacity >= ALPHA_MIN)/if !(opacity > ALPHA_MIN)/
the stopping Gaussian is added @ raster.wgsl @ s/let weight = select(zero, alpha \* before.transmittance, adds);/let weight = select(zero, alpha * before.transmittance, hit);/
transmittance stops at 1e-3 @ shared/view.wgsl @ s/TRANSMITTANCE_STOP: f32 = 1e-4;/TRANSMITTANCE_STOP: f32 = 1e-3;/
pixel centres at whole numbers @ raster.wgsl @ s/+ within) + 0.5;/+ within);/
the near plane is strict @ project.wgsl @ s/if !(z >= view.near)/if !(z > view.near)/
depth keys of 16 bits @ project.wgsl @ s/keys\[k\] = bitcast<u32>(z);/keys[k] = bitcast<u32>(z) \& 0xffff0000u;/
order by ray length @ project.wgsl @ s/keys\[k\] = bitcast<u32>(z);/keys[k] = bitcast<u32>(z * length(vec3<f32>(slope, 1.0)));/
unstable sort @ radix.wgsl @ s/ & below);/ \& ~(below | (1u << (local % 32u))));/
tile range one short @ shared/frame.wgsl @ s/min(high - first, most)/min(high - first - 1, most)/
footprint one pixel short @ project.wgsl @ s/floor(center - 0.5 + wide)/floor(center - 1.5 + wide)/
the last pair is lost @ ranges.wgsl @ s/if i >= frame.pairs {/if i + 1u >= frame.pairs {/
blended in sRGB @ raster.wgsl @ s/vec4<f32>(color.x)/vec4<f32>(pow(color.x, 0.4545))/
the Jacobian is not clamped @ project.wgsl @ s/let at = clamp(slope, view.bounds.xz, view.bounds.yw);/let at = slope;/
the mean is clamped too @ project.wgsl @ s/let center = view.focal \* slope/let center = view.focal * clamp(slope, view.bounds.xz, view.bounds.yw)/
eps2d is always 0.3 @ project.wgsl @ s/let eps = view.eps2d/let eps = 0.3/
determinant as ac - b² @ project.wgsl @ s/let determinant = sharp + eps.*/let determinant = (uu + eps) * (vv + eps) - dot(u, v) * dot(u, v);/
what is not finite is not dropped @ project.wgsl @ s/if scale.w == 0.0 {/if scale.w == 2.0 {/
depth is not weighted by alpha @ raster.wgsl @ s/fma(weight, vec4<f32>(detail.z), before.depth)/fma(alpha, vec4<f32>(detail.z), before.depth)/
LIST
)

build() { # cpu | gpu: builds the tests and lists them in $copy/tests.list
    local which=(--test golden_render --test render_properties)
    [ "$1" = cpu ] || which=(--features gpu --test golden_gpu)
    (cd "$copy" && cargo test -q --offline --release -p sharp-tests "${which[@]}" --no-run \
        --message-format=json 2>"$copy/errors" |
        grep -o '"executable":"[^"]*"' | cut -d'"' -f4 >"$copy/tests.list")
}

run_tests() { # runs what was built, all of it; fails if one fails
    local binary code=0
    : >"$copy/log"
    while read -r binary; do
        (cd "$copy/tests" && "$binary" --skip 'speed scene' --skip 6048x4032 --skip '16384 wide') \
            >>"$copy/log" 2>&1 || code=1
    done <"$copy/tests.list"
    return "$code"
}

survived=0
half() { # cpu | gpu, folder, list, names
    local backend=$1 folder=$2 name file expression
    if ! build "$backend" || ! run_tests; then
        tail -n 30 "$copy/errors" "$copy/log"
        echo "STALE     $backend: the tests fail without any mutation"
        survived=1
        return
    fi
    if grep -q 'no adapter' "$copy/log"; then
        echo "SKIPPED   $backend: no adapter"
        return
    fi
    while IFS='@' read -r name file expression; do
        name=$(sed 's/ *$//' <<<"$name")
        file=$folder/$(tr -d ' ' <<<"$file")
        if [ $# -gt 3 ] && [[ " ${*:4} " != *" $name "* ]]; then continue; fi
        sed -i "$expression" "$copy/$file"
        if cmp -s "$root/$file" "$copy/$file"; then
            echo "STALE     $backend: $name: changes nothing in $file"
            survived=1
        elif ! build "$backend"; then
            echo "STALE     $backend: $name: does not compile"
            sed -n '1,12p' "$copy/errors"
            survived=1
        elif run_tests; then
            echo "SURVIVED  $backend: $name"
            survived=1
        else
            echo "caught    $backend: $name ($(grep -cE '^test .* FAILED$' "$copy/log" || true) tests fail)"
        fi
        cp "$root/$file" "$copy/$file"
    done <<<"$3"
}

halves=${MUTANTS_HALVES:-cpu gpu}
[[ $halves != *cpu* ]] || half cpu sharp/src/render "$cpu" "$@"
[[ $halves != *gpu* ]] || half gpu shaders "$gpu" "$@"
exit $survived
