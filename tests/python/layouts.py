"""The procedural scene in the layouts that datasets are published in: what the pages' commands run on."""

import json

import numpy as np
from PIL import Image

import sharp_bench as sb

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def world_from_camera(view):
    return np.linalg.inv(np.asarray(view.camera.camera_from_world).reshape(4, 4))


def put(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, str):
        path.write_text(content)
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        # Always PNG, because readers ignore the extension.
        Image.fromarray(content).save(path, format="PNG")


def numbers(values):
    return " ".join(repr(float(value)) for value in np.ravel(values))


def quaternion(rotation):
    """w, x, y, z of a rotation that is far from a half turn, as all of these are."""
    w = np.sqrt(1.0 + np.trace(rotation)) / 2
    skew = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    return [w, *(np.array(skew) / (4 * w))]


def colmap_model(folder, views, name):
    k = views[0].camera.K
    size = f"{views[0].camera.width} {views[0].camera.height}"
    put(folder / "cameras.txt", f"1 PINHOLE {size} {numbers([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])}\n")
    lines = []
    for index, view in enumerate(views):
        pose = np.asarray(view.camera.camera_from_world).reshape(4, 4)
        lines.append(f"{index + 1} {numbers(quaternion(pose[:3, :3]))} {numbers(pose[:3, 3])} 1 {name(view)}\n\n")
    put(folder / "images.txt", "".join(lines))


def transforms(views, name, swapped=False, **more):
    k = views[0].camera.K
    swap = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1.0]]) if swapped else np.eye(4)
    frames = [
        {"file_path": name(view), "transform_matrix": (swap @ world_from_camera(view) @ FLIP).tolist()}
        | {key: value.format(view.id) for key, value in more.items()}
        for view in views
    ]
    head = {"camera_model": "PINHOLE", "fl_x": k[0, 0], "fl_y": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
    return json.dumps({**head, "w": views[0].camera.width, "h": views[0].camera.height, "frames": frames})


def millimetres(view):
    return np.round(view.depth() * 1000).astype(np.uint16)


def points(views):
    """World points of every pixel with depth, [N, 3]."""
    found = []
    for view in views:
        depth = view.depth()
        y, x = np.nonzero(depth > 0)
        pixels = np.stack([x + 0.5, y + 0.5, np.ones(len(x))])
        local = np.linalg.inv(view.camera.K) @ pixels * depth[y, x]
        pose = world_from_camera(view)
        found.append((pose[:3, :3] @ local + pose[:3, 3:]).T)
    return np.concatenate(found)


def surface(view):
    """World points of every pixel, row by row, and triangles between neighbours of about the same depth."""
    depth = view.depth()
    height, width = depth.shape
    y, x = np.mgrid[:height, :width]
    local = np.linalg.inv(view.camera.K) @ np.stack([x + 0.5, y + 0.5, np.ones_like(depth)]).reshape(3, -1) * depth.ravel()
    pose = world_from_camera(view)
    corners = np.stack([(y * width + x)[a : height - 1 + a, b : width - 1 + b] for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))], -1)
    corners = corners.reshape(-1, 4)
    at = depth.ravel()[corners]
    corners = corners[(at.min(1) > 0) & (at.max(1) < 1.1 * at.min(1))]
    return (pose[:3, :3] @ local + pose[:3, 3:]).T, np.concatenate([corners[:, [0, 2, 1]], corners[:, [1, 2, 3]]])


def mesh_file(views):
    vertices, triangles, count = [], [], 0
    for view in views:
        found, faces = surface(view)
        vertices.append(found)
        triangles.append(faces + count)
        count += len(found)
    vertices, triangles = np.concatenate(vertices), np.concatenate(triangles)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
    head += f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.zeros(len(triangles), [("n", "u1"), ("corners", "<i4", 3)])
    rows["n"], rows["corners"] = 3, triangles
    return head.encode() + vertices.astype("<f4").tobytes() + rows.tobytes()


def write_all(data):
    """Writes `data/{colmap, nerfstudio, stereo, eth3d, wildrgbd, tanks, scannetpp, booster}`."""
    views = sb.datasets("synthetic=size=96x72,views=8")[0].scenes[0].views
    for view in views:
        picture, png, jpg = view.image(), f"{view.id}.png", f"{view.id}.JPG"
        put(data / "nerfstudio/images" / png, picture)
        put(data / "nerfstudio/depth" / png, millimetres(view))
        put(data / "eth3d/courtyard/images/dslr_images_undistorted" / jpg, picture)
        depth = np.where(view.depth() > 0, view.depth(), np.inf).astype("<f4")
        put(data / "eth3d/courtyard/ground_truth_depth/dslr_images" / jpg, depth.tobytes())
        put(data / "scannetpp/data/a1b2c3/dslr/resized_undistorted_images" / jpg, picture)
    # Large enough for the frames of published protocols.
    large = sb.datasets("synthetic=size=384x288,views=5")[0].scenes[0].views
    (data / "colmap/room/depth").mkdir(parents=True)
    for view in large:
        put(data / "colmap/room/images" / f"{view.id}.png", view.image())
        np.save(data / f"colmap/room/depth/{view.id}.npy", view.depth())
    colmap_model(data / "colmap/room/sparse/0", large, lambda view: f"{view.id}.png")
    put(data / "nerfstudio/transforms.json", transforms(views, lambda view: f"images/{view.id}.png", depth_file_path="depth/{}.png"))
    for kind in ("jpg", "undistorted"):
        folder = "dslr_images" + "_undistorted" * (kind == "undistorted")
        colmap_model(data / f"eth3d/courtyard/dslr_calibration_{kind}", views, lambda view: f"{folder}/{view.id}.JPG")
    put(data / "scannetpp/splits/nvs_sem_val.txt", "a1b2c3\n")
    put(data / "scannetpp/data/a1b2c3/scans/mesh_aligned_0.05.ply", mesh_file(views[::3]))
    put(
        data / "scannetpp/data/a1b2c3/dslr/nerfstudio/transforms_undistorted.json",
        transforms(views, lambda view: f"{view.id}.JPG", swapped=True),
    )
    ply = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
    cloud = points(views)

    # WildRGB-D: column-major K with integer pixel centres.
    scene = data / "wildrgbd/cup/scenes/scene_000"
    k = np.array(views[0].camera.K)
    k[:2, 2] -= 0.5
    put(scene / "metadata", json.dumps({"w": views[0].camera.width, "h": views[0].camera.height, "K": k.T.ravel().tolist()}))
    for index, view in enumerate(views):
        put(scene / f"rgb/{index:05}.png", view.image())
        put(scene / f"depth/{index:05}.png", millimetres(view))
    put(scene / "cam_poses.txt", "".join(f"{index} {numbers(world_from_camera(view))}\n" for index, view in enumerate(views)))
    put(data / "wildrgbd/cup/nvs_list.json", json.dumps({"train": [], "val": ["scenes/scene_000"]}))

    # Tanks and Temples: a log of camera-to-world poses, an alignment and a scan.
    scene = data / "tanks/Barn"
    log = []
    for index, view in enumerate(views):
        put(scene / f"images/{index + 1:06}.jpg", view.image())
        log.append(f"{index} {index} 0\n" + "".join(numbers(row) + "\n" for row in world_from_camera(view)))
    put(scene / "Barn_COLMAP_SfM.log", "".join(log))
    put(scene / "Barn_trans.txt", numbers(np.eye(4)))
    put(scene / "Barn.ply", ply.format(len(cloud)).encode() + cloud.astype("<f8").tobytes())
    colmap_model(scene, views, lambda view: f"{view.id}.jpg")
    (scene / "images.txt").unlink()

    # Booster, and a plain pair, smaller than the bundled one.
    left, right = (np.full((72, 96, 3), level, np.uint8) for level in (90, 100))
    left[20:50, 40:70] = right[20:50, 34:64] = (200, 60, 30)
    disparity = np.full((72, 96), 6, np.float32)
    scene = data / "booster/train/balanced/Glass"
    matrix = '<{0} type_id="opencv-matrix"><rows>3</rows><cols>4</cols><dt>d</dt><data>86.4 0. 48. {1} 0. 86.4 36. 0. 0. 0. 1. 0.</data></{0}>'
    rig = matrix.format("proj_matL", "0.") + matrix.format("proj_matR", "-8640.")
    put(scene / "calib_00-02.xml", f'<?xml version="1.0"?><opencv_storage>{rig}<baselineLR>1.0e+02</baselineLR></opencv_storage>')
    for number, side, picture in (("00", "left", left), ("02", "right", right)):
        put(scene / f"camera_{number}/im0.png", picture)
        np.save(scene / f"disp_{number}.npy", disparity)
        put(data / f"stereo/desk/{side}.png", picture)
    np.save(data / "stereo/desk/disparity_left.npy", disparity)
    put(data / "stereo/desk/rig.txt", "fx=86.4\ncx_left=48.5\ncx_right=48.5\ncy=36.5\nbaseline_m=0.1\n")
