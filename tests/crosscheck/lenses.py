"""Our camera models, undistortion maps and undistorted pictures against OpenCV's."""

import json
import subprocess

import cv2
import numpy as np

# Both are f64 and closed forms.
PIXELS = 1e-9
# Ours converges to rounding; OpenCV's iteration of its perspective polynomial stops near 1e-7.
FISHEYE_INVERSE = 1e-9
PERSPECTIVE_INVERSE = 1e-7
# OpenCV stores maps as f32: half a unit in the last place of a coordinate below 1024, and the sum of
# its own increments.
MAP_F32 = 1e-4
# OpenCV rounds places to 1/32 of a pixel before it blends: on a picture that changes by at most eight
# levels a pixel that is 2 · 8 / 64, and two roundings to whole levels.
LEVELS = 1
# OpenCV inverts the lens in ten steps.
FOCAL = 1e-6

SIZE = (640, 480)
# name of COLMAP's model, parameters after the focal lengths and centre, one focal length only
LENSES = [
    ("SIMPLE_RADIAL", [-0.05], True),
    ("RADIAL", [-0.09, 0.02], True),
    ("OPENCV", [-0.1, 0.04, 7e-4, -4e-4], False),
    ("FULL_OPENCV", [0.3, -0.15, 5e-4, -3e-4, 0.02, 0.31, -0.12, 0.01], False),
    ("SIMPLE_RADIAL_FISHEYE", [-0.02], True),
    ("RADIAL_FISHEYE", [-0.02, 0.003], True),
    ("OPENCV_FISHEYE", [-0.03, -0.008, -9e-4, 3e-4], False),
    ("THIN_PRISM_FISHEYE", [0.05, -0.02, 4e-4, -3e-4, 0.004, 0.0, -8e-4, 6e-4], False),
]


def opencv_distortion(model, extra):
    """Coefficients in OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, or fisheye k1…k4."""
    if model == "THIN_PRISM_FISHEYE":
        k1, k2, p1, p2, k3, k4, sx, sy = extra
        assert k4 == 0.0, "OpenCV's polynomial ends with k3"
        return np.array([k1, k2, p1, p2, k3, 0, 0, 0, sx, 0, sy, 0])
    if "FISHEYE" in model:
        return np.array((extra + [0.0] * 4)[:4])
    return np.array((extra + [0.0] * 8)[:8])


def opencv_project(model, points, k, distortion):
    zero = np.zeros(3)
    if model == "THIN_PRISM_FISHEYE":
        # The fisheye part is computed here; OpenCV's thin prism is applied to its result.
        uv = points[:, :2] / points[:, 2:]
        radius = np.linalg.norm(uv, axis=1, keepdims=True)
        scale = np.where(radius > 0, np.arctan(radius) / np.where(radius > 0, radius, 1), 1)
        points = np.column_stack([uv * scale, np.ones(len(uv))])
        return cv2.projectPoints(points, zero, zero, k, distortion)[0][:, 0]
    if "FISHEYE" in model:
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, k, distortion)[0][:, 0]
    return cv2.projectPoints(points, zero, zero, k, distortion)[0][:, 0]


def smooth_picture():
    """Changes by less than eight levels a pixel."""
    width, height = SIZE
    y, x = np.mgrid[:height, :width]
    waves = [127.5 + 120 * np.sin(x / 23 + p) * np.cos(y / 31 - p) for p in (0.0, 1.3, 2.1)]
    return np.round(np.stack(waves, -1)).astype(np.uint8)


def spotted_mask(rng):
    """255 but for rectangles, some at the border, and pixels of any value."""
    width, height = SIZE
    mask = np.full((height, width), 255, np.uint8)
    for _ in range(25):
        x, y = rng.integers(-20, width), rng.integers(-20, height)
        mask[max(y, 0) : y + rng.integers(25, 60), max(x, 0) : x + rng.integers(25, 60)] = 0
    spots = rng.integers(0, height, 400), rng.integers(0, width, 400)
    mask[spots] = rng.integers(0, 255, 400)
    return mask


def remapped_mask(mask, maps):
    """ScanNet++'s recipe."""
    remapped = cv2.remap(mask, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=255)
    return np.where(remapped < 255, 0, 255)


EXPECTED = {f"{what} {model}" for model, *_ in LENSES for what in ("forward, px", "round trip")}
EXPECTED |= {f"map, px {model}" for model, *_ in LENSES}
EXPECTED |= {f"{what} {model}" for what in ("undistorted", "mask")
             for model, *_ in LENSES if model != "THIN_PRISM_FISHEYE"}
EXPECTED |= {"inverse OPENCV", "inverse OPENCV_FISHEYE", "ScanNet++ focal"}


def compare(comparison, program, rng, folder):
    folder.mkdir(parents=True, exist_ok=True)
    width, height = SIZE
    taken = smooth_picture()
    (folder / "taken.u8").write_bytes(taken.tobytes())
    mask = spotted_mask(rng)
    (folder / "mask.u8").write_bytes(mask.tobytes())
    requests, cases = [], []
    for model, extra, single in LENSES:
        fisheye = "FISHEYE" in model
        fx = rng.uniform(380, 420) if fisheye else rng.uniform(540, 580)
        fy = fx if single else fx * rng.uniform(0.98, 1.02)
        cx, cy = width / 2 + rng.uniform(-9, 9), height / 2 + rng.uniform(-9, 9)
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        depth = rng.uniform(0.3, 20, (3000, 1))
        uv = rng.uniform(-0.75, 0.75, (3000, 2))
        points = np.column_stack([uv * depth, depth])
        distortion = opencv_distortion(model, extra)
        pixels = opencv_project(model, points, k, distortion)
        pinhole = [fx * 1.1, fy * 1.1, width / 2, height / 2]
        requests.append({
            "model": model,
            "params": ([fx] if single else [fx, fy]) + [cx, cy] + extra,
            "size": list(SIZE),
            "points": points.tolist(),
            "pixels": pixels.tolist(),
            "pinhole": pinhole,
            "picture": str(folder / "taken.u8"),
            "undistorted": str(folder / f"{model}.u8"),
            "mask": str(folder / "mask.u8"),
            "masked": str(folder / f"{model}.mask.u8"),
        })
        cases.append((model, k, distortion, points, pixels, pinhole))
    answers = json.loads(subprocess.run([str(program)], input=json.dumps(requests), text=True,
                                        check=True, stdout=subprocess.PIPE).stdout)

    for (model, k, distortion, points, pixels, pinhole), ours in zip(cases, answers, strict=True):
        fisheye = "FISHEYE" in model
        comparison.add(f"forward, px {model}", "OpenCV", ours["projected"], pixels, PIXELS)
        tolerance = FISHEYE_INVERSE if fisheye else PERSPECTIVE_INVERSE
        comparison.add(f"round trip {model}", "the points projected", ours["unprojected"],
                       points[:, :2] / points[:, 2:], tolerance)
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 400, 1e-14)
        if model == "OPENCV":
            theirs = cv2.undistortPoints(pixels[:, None], k, distortion, criteria=criteria)
            comparison.add("inverse OPENCV", "OpenCV", ours["unprojected"], theirs[:, 0], tolerance)
        if model == "OPENCV_FISHEYE":
            theirs = cv2.fisheye.undistortPoints(pixels[:, None], k, distortion, criteria=criteria)
            comparison.add("inverse OPENCV_FISHEYE", "OpenCV", ours["unprojected"], theirs[:, 0], tolerance)
            # The recipe gives OpenCV the centres as COLMAP has them.
            theirs = cv2.fisheye.estimateNewCameraMatrixForUndistortRectify(
                k, distortion, SIZE, np.eye(3), balance=0)
            comparison.add("ScanNet++ focal", "OpenCV", np.divide(ours["scannetpp_focal"], [k[0, 0], k[1, 1]]),
                           np.divide([theirs[0, 0], theirs[1, 1]], [k[0, 0], k[1, 1]]), FOCAL)

        # Each pixel's ray, projected in f64; then the maps that OpenCV itself makes, in f32 and with
        # pixel centres at whole numbers.
        map_ = np.array(ours["map"], np.float64)
        y, x = np.mgrid[:height, :width]
        rays = np.column_stack([(x.ravel() + 0.5 - pinhole[2]) / pinhole[0],
                                (y.ravel() + 0.5 - pinhole[3]) / pinhole[1], np.ones(width * height)])
        comparison.add(f"map, px {model}", "OpenCV projectPoints", map_,
                       opencv_project(model, rays, k, distortion), PIXELS)
        if model == "THIN_PRISM_FISHEYE":
            continue
        integer = k - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
        new = np.array([[pinhole[0], 0, pinhole[2] - 0.5], [0, pinhole[1], pinhole[3] - 0.5], [0, 0, 1]])
        make = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
        maps = make(integer, distortion, np.eye(3), new, SIZE, cv2.CV_32FC1)
        comparison.add(f"map, px {model}", "OpenCV initUndistortMap", map_ - 0.5,
                       np.column_stack([maps[0].ravel(), maps[1].ravel()]), MAP_F32)
        theirs = cv2.remap(taken, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        undistorted = np.fromfile(folder / f"{model}.u8", np.uint8).reshape(theirs.shape)
        comparison.add(f"undistorted {model}", "OpenCV remap", undistorted, theirs, LEVELS)
        # Where OpenCV's result does not depend on the last digits of its f32 maps, ours is the same.
        theirs = remapped_mask(mask, maps)
        shifts = [(x, y) for x in (-MAP_F32, MAP_F32) for y in (-MAP_F32, MAP_F32)]
        firm = np.all([remapped_mask(mask, (maps[0] + np.float32(x), maps[1] + np.float32(y))) == theirs
                       for x, y in shifts], axis=0)
        assert firm.mean() > 0.99 and (theirs[firm] == 0).sum() > 1000
        masked = np.fromfile(folder / f"{model}.mask.u8", np.uint8).reshape(mask.shape)
        comparison.add(f"mask {model}", "OpenCV remap", masked[firm], theirs[firm], 0)
