#!/usr/bin/env bash
# Shows that the tests of the renderer catch wrong rules: changes one rule at a time in a copy of
# the sources, builds, and expects a test to fail.
#
# usage: tests/mutants/render.sh [NAME…]      prints a line per mutation; exit 1 if one survives
set -euo pipefail
root=$(git -C "$(dirname "$0")" rev-parse --show-toplevel)
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
git -C "$root" ls-files -z | (cd "$root" && xargs -0 cp --parents -t "$copy")
export CARGO_TARGET_DIR=${MUTANTS_TARGET_DIR:-$copy/target}
src=sharp/src/render

# name @ file in sharp/src/render @ sed expression
mutations=$(cat <<'LIST'
alpha clamped at 0.99 @ raster.rs @ s/ALPHA_MAX: f32 = 0.999;/ALPHA_MAX: f32 = 0.99;/
no skip below 1/255 @ raster.rs @ s/let hit = alpha_min.le(alpha);/let hit = zero.le(alpha);/
skip at 2/255 @ raster.rs @ s/(L::splat(ALPHA_MIN), /(L::splat(2.0 * ALPHA_MIN), /
opacity of exactly 1/255 dropped @ project.rs @ s/scene.opacities\[k\] < ALPHA_MIN/scene.opacities[k] <= ALPHA_MIN/
the stopping Gaussian is added @ raster.rs @ s/let adds = left.gt_where(stop, hit);/let adds = left.gt_where(zero, hit);/; s/done.add(transmittance.masked(stops))/done.add(left.masked(stops))/; s/L::select(adds, left, transmittance);/L::select(left.gt_where(stop, hit), left, transmittance);/
transmittance stops at 1e-3 @ raster.rs @ s/TRANSMITTANCE_STOP: f32 = 1e-4;/TRANSMITTANCE_STOP: f32 = 1e-3;/
pixel centres at whole numbers @ raster.rs @ s/as f32 + 0.5$/as f32/
the near plane is strict @ project.rs @ s/c.z\[i\] < constants.near/c.z[i] <= constants.near/
depth keys of 16 bits @ emit.rs @ s/u64::from(z.to_bits()) << 32/u64::from(z.to_bits() >> 16 << 16) << 32/
order by ray length @ project.rs @ s/c.z\[i\] = z as f32;/c.z[i] = (x * x + y * y + z * z).sqrt() as f32;/
unstable sort: ties by descending index @ radix.rs @ s/for key in &\*keys {/for key in keys.iter().rev() {/
tile range one short @ ranges.rs @ s/\[y \* side + x0..y \* side + x1 + 1\]/[y * side + x0..y * side + x1.max(x0)]/; s/\[row + x0..row + x1 + 1\]/[row + x0..row + x1.max(x0)]/
footprint one pixel short @ project.rs @ s/let last = (at + reach).floor()/let last = (at + reach - 1.0).floor()/
blended in sRGB @ project.rs @ s/color: scene.colors\[k\],/color: scene.colors[k].map(crate::color::srgb_from_linear),/
the Jacobian is not clamped @ project.rs @ s/JACOBIAN_MARGIN: f64 = 0.3;/JACOBIAN_MARGIN: f64 = 30.0;/
the mean is clamped too @ project.rs @ s/k.focal\[0\] \* slope_x + k.center\[0\]/k.focal[0] * slope_x.max(k.bounds[0][0]).min(k.bounds[0][1]) + k.center[0]/
eps2d is always 0.3 @ project.rs @ s/eps2d: f64::from(view.eps2d)/eps2d: 0.3/
determinant as ac - b² in f32 @ project.rs @ s/let determinant = cross + .*/let determinant = f64::from((uu + k.eps2d) as f32 * (vv + k.eps2d) as f32 - b as f32 * b as f32);/
depth is not weighted by alpha @ raster.rs @ s/depth = weight.mul_add(L::splat(s.z), depth);/depth = transmittance.mul_add(L::splat(s.z), depth);/
LIST
)

survived=0
while IFS='@' read -r name file expression; do
    name=$(sed 's/ *$//' <<<"$name")
    file=$(tr -d ' ' <<<"$file")
    if [ $# -gt 0 ] && [[ " $* " != *" $name "* ]]; then continue; fi
    cp "$root/$src/$file" "$copy/$src/$file"
    sed -i "$expression" "$copy/$src/$file"
    if cmp -s "$root/$src/$file" "$copy/$src/$file"; then
        echo "STALE     $name: changes nothing in $src/$file"
        survived=1
    elif ! (cd "$copy" && cargo build -q --release -p sharp 2>"$copy/errors"); then
        echo "STALE     $name: does not compile"
        sed -n '1,12p' "$copy/errors"
        survived=1
    elif (cd "$copy" && cargo test -q --release -p sharp-tests --test golden_render --test render_properties >"$copy/log" 2>&1); then
        echo "SURVIVED  $name"
        survived=1
    else
        echo "caught    $name ($(grep -c '^    s[0-9]' "$copy/log" || true) of 12 pictures)"
    fi
    cp "$root/$src/$file" "$copy/$src/$file"
done <<<"$mutations"
exit $survived
