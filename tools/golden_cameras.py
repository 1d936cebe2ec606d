#!/usr/bin/env python3
"""Golden values of OpenCV's camera model for crates/relight-scene/tests/golden/cameras.json.

    pip install opencv-python-headless numpy        # 4.8 or later; 5.0.0 was used
    python3 tools/golden_cameras.py > crates/relight-scene/tests/golden/cameras.json

For each number of distortion coefficients: points of the camera's frame, the pixels at which cv2.projectPoints shows
them, and the normalised points that cv2.undistortPoints (run to convergence) finds for those pixels.
"""
import json
import sys

import cv2
import numpy as np

WIDTH, HEIGHT = 1440, 1080
MATRIX = np.array([[2321.0, 0, 868.0], [0, 2388.0, 454.0], [0, 0, 1]])
WIDE = np.array([[700.0, 0, 719.5], [0, 705.0, 539.5], [0, 0, 1]])
LENSES = {
    0: (MATRIX, []),
    4: (MATRIX, [-0.11, 0.14, 0.0011, -0.0007]),
    5: (WIDE, [-0.28, 0.09, 0.0005, 0.0004, -0.012]),
    8: (WIDE, [0.31, -0.12, 0.0012, -0.0008, 0.021, 0.62, -0.05, 0.034]),
    12: (WIDE, [0.31, -0.12, 0.0012, -0.0008, 0.021, 0.62, -0.05, 0.034, 0.0021, -0.0013, 0.0017, 0.0009]),
    14: (WIDE, [0.31, -0.12, 0.0012, -0.0008, 0.021, 0.62, -0.05, 0.034, 0.0021, -0.0013, 0.0017, 0.0009, 0.03, -0.02]),
}


def main():
    rng = np.random.default_rng(7)
    cases = []
    for count, (matrix, distortion) in LENSES.items():
        pixels = rng.uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (40, 2))
        depth = rng.uniform(0.2, 3.0, (40, 1))
        ideal = np.c_[(pixels - matrix[:2, 2]) / [matrix[0, 0], matrix[1, 1]], np.ones(40)]
        points = ideal * depth
        coefficients = np.array(distortion)
        zero = np.zeros(3)
        seen = cv2.projectPoints(points, zero, zero, matrix, coefficients)[0].reshape(-1, 2)
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
        undistort = getattr(cv2, 'undistortPointsIter', cv2.undistortPoints)
        eye = np.eye(3)
        rays = undistort(seen.reshape(-1, 1, 2), matrix, coefficients, R=eye, P=eye, criteria=criteria).reshape(-1, 2)
        cases.append(dict(
            coefficients=count, distortion=distortion, width=WIDTH, height=HEIGHT,
            fx=matrix[0, 0], fy=matrix[1, 1], cx=matrix[0, 2], cy=matrix[1, 2],
            points=points.tolist(), pixels=seen.tolist(), rays=rays.tolist()))
        print(count, 'OpenCV round trip', np.abs(rays - ideal[:, :2]).max(), file=sys.stderr)
    json.dump(dict(opencv=cv2.__version__, cases=cases), sys.stdout)
    print()


if __name__ == '__main__':
    main()
