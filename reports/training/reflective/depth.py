"""Depth on mirrors and panes: python depth.py SCENES CHECKPOINT CONFIG [CHECKPOINT CONFIG …]

A pixel counts as added if its surface in world=reflective is more than 3 % nearer than that of the same camera in world=varied. Predicted
depth is rendered from the source's camera and scaled by the median over all other pixels. Errors are means of ln(predicted / true); a
positive one is too far away. Scenes whose cameras differ between the two worlds, or with less than 2 % of added pixels, are left out.
"""

import sys

import numpy as np
import sharp_bench as sb

SPEC = "{0}:synthetic=world={0},seed=900000,size=256x256,views=2,scenes={1}"
count = int(sys.argv[1])
networks = list(zip(sys.argv[2::2], sys.argv[3::2]))
rows = []
reflective, varied = sb.datasets(SPEC.format("reflective", count), SPEC.format("varied", count))
for scene, plain in zip(reflective.scenes, varied.scenes):
    view, other = scene.views[0], plain.views[0]
    cameras = [(v.camera.K, v.camera.camera_from_world) for v in (view, other)]
    if not all(np.array_equal(a, b) for a, b in zip(*cameras)):
        continue
    depth, behind = view.depth(), other.depth()
    seen = depth > 0
    added = seen & ((behind == 0) | (depth < 0.97 * behind))
    rest = seen & ~added
    if added.mean() < 0.02 or rest.mean() < 0.2:
        continue
    errors = []
    for checkpoint, config in networks:
        gaussians = sb.predict(view.image(), view.camera.K[0][0], checkpoint=checkpoint, config=config)
        predicted = sb.render(gaussians, sb.Camera(256, 256, view.camera.K)).depth
        both = seen & (predicted > 0)
        log = np.log(np.where(both, predicted, 1) / np.where(both, depth, 1))
        log -= np.median(log[rest & both])
        on_added, elsewhere = log[added & both], log[rest & both]
        errors.append([on_added.mean(), np.abs(on_added).mean(), np.abs(elsewhere).mean()])
    rows.append(errors)
rows = np.array(rows)
print(f"{len(rows)} scenes: signed on added, absolute on added, absolute elsewhere")
for (checkpoint, _), mean in zip(networks, rows.mean(0)):
    print(checkpoint, np.round(mean, 4))
for before, after in zip(range(len(networks)), range(1, len(networks))):
    change = rows[:, after] - rows[:, before]
    print("change", np.round(change.mean(0), 4), "±", np.round(1.96 * change.std(0, ddof=1) / len(rows) ** 0.5, 4))
