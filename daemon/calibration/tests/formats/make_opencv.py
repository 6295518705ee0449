#!/usr/bin/env python3
"""Makes the OpenCV files here: cameras of ../opencv/points.txt, as OpenCV itself stores them.

    python3 -m venv venv && venv/bin/pip install opencv-python-headless==4.11.0.86
    venv/bin/python make_opencv.py 4        and the same with 5.0.0.93 and 5

`decentred` in each syntax and under each key set, in millimetres; `decentred` and `shifted` in one file under names.
"""

import pathlib
import sys

import cv2
import numpy as np

HERE = pathlib.Path(__file__).parent


def lenses():
    for line in (HERE / "../opencv/points.txt").read_text().splitlines():
        if line.startswith("lens"):
            words = [word for word in line.split()[1:] if word != "|"]
            name, numbers = words[0], [float(word) for word in words[1:]]
            (width, height, fx, fy, cx, cy), rest = numbers[:6], numbers[6:]
            matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
            rotation, translation = np.array(rest[5:14]).reshape(3, 3), np.array(rest[14:]).reshape(3, 1)
            yield name, (int(width), int(height), matrix, np.array([rest[:5]]), rotation, translation)


def write(path, put):
    storage = cv2.FileStorage(str(HERE / path), cv2.FILE_STORAGE_WRITE)
    put(storage)
    storage.release()


def main():
    version, all_lenses = sys.argv[1], dict(lenses())
    width, height, matrix, distortion, rotation, translation = all_lenses["decentred"]

    def procam(storage):
        storage.write("rms", 0.25)
        for key, value in (
            ("cam_int", np.eye(3)),
            ("cam_dist", np.zeros((1, 5))),
            ("proj_int", matrix),
            ("proj_dist", distortion),
            ("roration", rotation),
            ("translation", translation * 1000),
        ):
            storage.write(key, value)

    def procamcalib(storage):
        for key, value in (
            ("cam_K", np.eye(3)),
            ("proj_K", matrix),
            ("proj_kc", distortion),
            ("R", rotation),
            ("T", translation * 1000),
        ):
            storage.write(key, value)

    def sample(storage):
        storage.write("calibration_time", "a day")
        storage.write("image_width", width)
        storage.write("image_height", height)
        for key, value in (("camera_matrix", matrix), ("distortion_coefficients", distortion)):
            storage.write(key, value)
        storage.write("rvec", cv2.Rodrigues(rotation)[0])
        storage.write("tvec", translation * 1000)

    def several(storage):
        for name in ("decentred", "shifted"):
            _, _, matrix, distortion, rotation, translation = all_lenses[name]
            storage.startWriteStruct(name, cv2.FileNode_MAP)
            for key, value in (
                ("camera_matrix", matrix),
                ("distortion_coefficients", distortion),
                ("R", rotation),
                ("T", translation * 1000),
            ):
                storage.write(key, value)
            storage.endWriteStruct()

    for name, put in (("procam", procam), ("procamcalib", procamcalib), ("sample", sample), ("several", several)):
        # Version 5 differs in what its YAML starts with, and in nothing else.
        for syntax in ("yml", "xml", "json") if version == "4" else ("yml",):
            write(f"{name}-{version}.{syntax}", put)


main()
