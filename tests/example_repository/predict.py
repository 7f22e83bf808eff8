#!/usr/bin/env python3
"""The model: the photograph on a plane that faces the source camera, seen from the target camera.

usage: predict.py PAIRS PREDICTIONS

PAIRS is what `sharp-bench pairs export` wrote. Needs nothing but Python 3.
"""

import json
import struct
import sys
import zlib
from pathlib import Path

DEPTH_M = 8.0


def read_png(path):
    """Rows of (r, g, b), 8 bit, not interlaced."""
    data = path.read_bytes()
    at, packed = 8, b""
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, *form = struct.unpack(">IIBBBBB", body)
            if form != [8, 2, 0, 0, 0]:
                sys.exit(f"{path}: 8-bit RGB without interlacing is needed")
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    raw, size, rows = zlib.decompress(packed), 3 * width, []
    above = bytearray(size)
    for start in range(0, height * (size + 1), size + 1):
        method, row = raw[start], bytearray(raw[start + 1 : start + 1 + size])
        for i in range(size):
            left = row[i - 3] if i >= 3 else 0
            corner = above[i - 3] if i >= 3 else 0
            estimate = left + above[i] - corner
            nearest = min((left, above[i], corner), key=lambda value: abs(estimate - value))
            row[i] = (row[i] + (0, left, above[i], (left + above[i]) // 2, nearest)[method]) % 256
        rows.append([tuple(row[i : i + 3]) for i in range(0, size, 3)])
        above = row
    return rows


def write_png(path, rows):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 8, 2, 0, 0, 0)
    raw = b"".join(b"\0" + bytes(level for pixel in row for level in pixel) for row in rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
    )


def sample(rows, x, y):
    """Bilinear, the border continued; the centre of the first pixel is at (0.5, 0.5)."""
    x = min(max(x - 0.5, 0.0), len(rows[0]) - 1.0)
    y = min(max(y - 0.5, 0.0), len(rows) - 1.0)
    left, top = int(x), int(y)
    right, bottom = min(left + 1, len(rows[0]) - 1), min(top + 1, len(rows) - 1)
    x, y = x - left, y - top
    corners = zip(rows[top][left], rows[top][right], rows[bottom][left], rows[bottom][right])
    mixed = ((a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + d * x) * y for a, b, c, d in corners)
    return tuple(int(level + 0.5) for level in mixed)


def predict(pair, photograph):
    matrix = pair["target_from_source"]
    rotation, move = [matrix[0:3], matrix[4:7], matrix[8:11]], matrix[3:12:4]
    fx, _, cx, _, fy, cy = pair["K_t"][:6]
    source_fx, _, source_cx, _, source_fy, source_cy = pair["K_s"][:6]
    # The target camera's centre, seen by the source camera.
    eye = [-sum(rotation[k][i] * move[k] for k in range(3)) for i in range(3)]
    picture = []
    for row in range(pair["target"]["height"]):
        line = []
        for column in range(pair["target"]["width"]):
            ray = ((column + 0.5 - cx) / fx, (row + 0.5 - cy) / fy, 1.0)
            x, y, z = (sum(rotation[k][i] * ray[k] for k in range(3)) for i in range(3))
            distance = (DEPTH_M - eye[2]) / z
            x, y = eye[0] + distance * x, eye[1] + distance * y
            line.append(
                sample(photograph, source_fx * x / DEPTH_M + source_cx, source_fy * y / DEPTH_M + source_cy)
            )
        picture.append(line)
    return picture


def main():
    pairs, predictions = map(Path, sys.argv[1:3])
    for path in sorted(pairs.rglob("pair.json")):
        pair = json.loads(path.read_text(encoding="utf-8"))
        write_png(predictions / pair["prediction"]["file"], predict(pair, read_png(path.parent / "source.png")))


if __name__ == "__main__":
    main()
