#!/usr/bin/env python3
"""A closed hall of about so many triangles, as a .glb: every ray that starts in it hits something.

    hall.py TRIANGLES FILE

20 m by 6 m by 12 m, floor at y = 0 and its middle at the origin. Floor, ceiling and walls bulge; eight fluted columns carry the
ceiling, and twelve lumpy balls lie about. Each surface is a grid, and gets triangles by its area, so that they are about equally
large everywhere. The same arguments give the same hall on every machine, but for the last bit of a sine. One material, `plaster`.
"""

import json
import math
import struct
import sys
from array import array

SIZE_M = (20.0, 6.0, 12.0)


def hashed(*words):
    """A number from 0 to 1 for a place on a lattice."""
    h = 0x9E3779B9
    for word in words:
        h = ((h ^ (word & 0xFFFFFFFF)) * 0x85EBCA6B) & 0xFFFFFFFF
        h ^= h >> 15
    return h / 0xFFFFFFFF


def noise(seed, x, y):
    """Smooth noise from -1 to 1 with one lump a unit."""
    i, j = math.floor(x), math.floor(y)
    s, t = x - i, y - j
    s, t = s * s * (3 - 2 * s), t * t * (3 - 2 * t)
    a, b = hashed(seed, i, j), hashed(seed, i + 1, j)
    c, d = hashed(seed, i, j + 1), hashed(seed, i + 1, j + 1)
    return 2 * (a + (b - a) * s + (c - a) * t + (a - b - c + d) * s * t) - 1


def lumps(seed, x, y):
    return 0.6 * noise(seed, x, y) + 0.3 * noise(seed + 1, 2.3 * x, 2.3 * y) + 0.1 * noise(seed + 2, 9.1 * x, 9.1 * y)


def wall(seed, corner, u_axis, v_axis, inward, bulge_m):
    """A bulging rectangle whose border stays where it is, so that walls meet."""
    width, height = math.dist(u_axis, (0, 0, 0)), math.dist(v_axis, (0, 0, 0))

    def point(u, v):
        hold = min(1.0, 12 * u, 12 * (1 - u)) * min(1.0, 12 * v, 12 * (1 - v))
        out = bulge_m * hold * (1 + lumps(seed, u * width, v * height))
        # What lies on the border is exact: there the other wall's points are the same numbers.
        return tuple(c + u * a + v * b + out * n for c, a, b, n in zip(corner, u_axis, v_axis, inward))

    return point, width, height


def column(seed, x, z):
    def point(u, v):
        angle = 2 * math.pi * u
        radius = 0.45 + 0.04 * math.cos(16 * angle) + 0.02 * lumps(seed, 6 * math.cos(angle), 4 * v + 3 * math.sin(angle))
        return (x + radius * math.sin(angle), -0.5 + v * (SIZE_M[1] + 1), z + radius * math.cos(angle))

    return point, 2 * math.pi * 0.5, SIZE_M[1] + 1


def ball(seed, x, z, size_m):
    def point(u, v):
        around, down = 2 * math.pi * u, math.pi * (1 - v)
        direction = (math.sin(down) * math.sin(around), math.cos(down), math.sin(down) * math.cos(around))
        radius = size_m * (1 + 0.15 * lumps(seed, 3 * direction[0] + direction[1], 3 * direction[2] - direction[1]))
        return (x + radius * direction[0], size_m + radius * direction[1], z + radius * direction[2])

    return point, 2 * math.pi * size_m, math.pi * size_m


def surfaces():
    w, h, d = SIZE_M
    x, z = w / 2, d / 2
    yield wall(1, (-x, 0.0, z), (w, 0.0, 0.0), (0.0, 0.0, -d), (0.0, 1.0, 0.0), 0.05)
    yield wall(11, (-x, h, -z), (w, 0.0, 0.0), (0.0, 0.0, d), (0.0, -1.0, 0.0), 0.25)
    yield wall(21, (-x, 0.0, -z), (w, 0.0, 0.0), (0.0, h, 0.0), (0.0, 0.0, 1.0), 0.25)
    yield wall(31, (x, 0.0, z), (-w, 0.0, 0.0), (0.0, h, 0.0), (0.0, 0.0, -1.0), 0.25)
    yield wall(41, (-x, 0.0, z), (0.0, 0.0, -d), (0.0, h, 0.0), (1.0, 0.0, 0.0), 0.25)
    yield wall(51, (x, 0.0, -z), (0.0, 0.0, d), (0.0, h, 0.0), (-1.0, 0.0, 0.0), 0.25)
    for i in range(8):
        yield column(61 + 7 * i, -6.75 + 4.5 * (i % 4), -3.2 if i < 4 else 3.2)
    for i in range(12):
        yield ball(201 + 7 * i, -8 + 15 * hashed(7, i), -4.5 + 9 * hashed(8, i), 0.3 + 0.5 * hashed(9, i))


def grid(positions, normals, indices, point, columns, rows):
    """A surface as columns × rows squares, with normals by central differences."""
    first = len(positions) // 3
    places = [[point(i / columns, j / rows) for i in range(columns + 1)] for j in range(rows + 1)]
    for j in range(rows + 1):
        for i in range(columns + 1):
            a, b = places[j][min(i + 1, columns)], places[j][max(i - 1, 0)]
            c, d = places[min(j + 1, rows)][i], places[max(j - 1, 0)][i]
            ux, uy, uz = a[0] - b[0], a[1] - b[1], a[2] - b[2]
            vx, vy, vz = c[0] - d[0], c[1] - d[1], c[2] - d[2]
            n = (uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
            length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
            positions.extend(places[j][i])
            # A pole of a ball has none; zeros ask the loader for the triangles' own.
            normals.extend((n[0] / length, n[1] / length, n[2] / length) if length > 1e-12 else (0.0, 0.0, 0.0))
    for j in range(rows):
        for i in range(columns):
            at = first + j * (columns + 1) + i
            above = at + columns + 1
            indices.extend((at, at + 1, above + 1, at, above + 1, above))


def hall(triangles):
    positions, normals, indices = array("f"), array("f"), array("I")
    all_of = list(surfaces())
    area = sum(width * height for _, width, height in all_of)
    side_m = math.sqrt(2 * area / triangles)
    for point, width, height in all_of:
        grid(positions, normals, indices, point, max(3, round(width / side_m)), max(3, round(height / side_m)))
    return positions, normals, indices


def glb(positions, normals, indices):
    parts = [part.tobytes() for part in (positions, normals, indices)]
    starts = [0, len(parts[0]), len(parts[0]) + len(parts[1])]
    low, high = ([f(positions[axis::3]) for axis in range(3)] for f in (min, max))
    count = len(positions) // 3
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "hall"}],
        "meshes": [{"name": "hall", "primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"name": "plaster", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0, "roughnessFactor": 1}}],
        "buffers": [{"byteLength": sum(map(len, parts))}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": len(part)} for start, part in zip(starts, parts)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5125, "count": len(indices), "type": "SCALAR"},
        ],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(parts)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(body))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body


def write(triangles, path):
    """Writes a hall, and gives how many triangles it has."""
    if sys.byteorder != "little":
        raise SystemExit("hall.py: a .glb is little-endian, and this machine is not")
    positions, normals, indices = hall(triangles)
    with open(path, "wb") as file:
        file.write(glb(positions, normals, indices))
    return len(indices) // 3


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    print(write(int(sys.argv[1]), sys.argv[2]), "triangles")
