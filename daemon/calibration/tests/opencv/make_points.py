#!/usr/bin/env python3
"""Makes points.txt: where OpenCV's cv2.projectPoints puts points through lenses of five coefficients.

    python3 -m venv venv && venv/bin/pip install opencv-python-headless==5.0.0.93
    venv/bin/python make_points.py > points.txt

A line `lens NAME W H fx fy cx cy k1 k2 p1 p2 k3 | R by rows | T`, then lines `point X Y Z u v`: world metres (x_camera = R x + T, x right,
y down, z forward) and OpenCV's pixel, whose (0, 0) is the middle of the first one. The points cover the whole image.
"""

import cv2
import numpy as np

# Name, size, fx, fy, cx, cy, (k1, k2, p1, p2, k3). The last has its axis below the image, as projectors for tables do.
LENSES = [
    ("none", 640, 480, 700.0, 700.0, 319.5, 239.5, (0, 0, 0, 0, 0)),
    ("barrel", 1280, 800, 900.0, 905.0, 633.2, 410.9, (-0.28, 0.06, 0, 0, 0)),
    ("pincushion", 1920, 1080, 2100.0, 2095.0, 980.3, 520.1, (0.21, 0.13, 0, 0, -0.02)),
    ("moustache", 1024, 768, 800.0, 800.0, 500.0, 380.0, (-0.35, 0.42, 0, 0, -0.11)),
    ("decentred", 1280, 720, 1000.0, 1010.0, 655.0, 345.0, (-0.12, 0.03, 0.011, -0.014, 0.004)),
    ("shifted", 1280, 800, 1800.0, 1800.0, 641.0, 905.0, (-0.11, 0.05, 0.001, 0.002, -0.01)),
]
GRID = 12


def main():
    print(f"# made by make_points.py with OpenCV {cv2.__version__}")
    random = np.random.default_rng(4)
    for name, width, height, fx, fy, cx, cy, k in LENSES:
        rotation, _ = cv2.Rodrigues(random.uniform(-2, 2, 3))
        translation = random.uniform(-1, 1, 3)
        camera = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        coefficients = np.array(k, dtype=float)

        def project(ideal, depth):
            in_camera = np.column_stack([ideal * depth[:, None], depth])
            world = (in_camera - translation) @ rotation
            pixels, _ = cv2.projectPoints(world, rotation, translation, camera, coefficients)
            return world, pixels.reshape(-1, 2)

        # A fine grid of directions, and of it for each place of a coarse one over the image the direction that lands nearest. Nearest to
        # the axis first, so that none beyond a fold of the polynomial is taken for one before it.
        span = np.linspace(-1.4, 1.4, 561) * max(width, height) / min(fx, fy)
        ideal = np.stack(np.meshgrid(span, span), -1).reshape(-1, 2)
        radius = np.hypot(*ideal.T)
        ideal = ideal[np.argsort(radius)]
        _, pixels = project(ideal, np.ones(len(ideal)))
        taken = []
        for row in np.linspace(0, height, GRID):
            for column in np.linspace(0, width, GRID):
                off = np.hypot(pixels[:, 0] + 0.5 - column, pixels[:, 1] + 0.5 - row)
                near = np.flatnonzero(off < 8.0)
                if len(near):
                    taken.append(near[0])
        ideal = ideal[sorted(set(taken))]
        world, pixels = project(ideal, random.uniform(0.4, 6.0, len(ideal)))

        words = [name, width, height, fx, fy, cx, cy, *k, "|", *rotation.ravel(), "|", *translation]
        print("lens", *(repr(float(w)) if isinstance(w, float) else str(w) for w in words))
        for (x, y, z), (u, v) in zip(world, pixels):
            print("point", *(repr(round(float(w), 9)) for w in (x, y, z)), *(repr(round(float(w), 6)) for w in (u, v)))


main()
