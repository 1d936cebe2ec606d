#!/usr/bin/env python3
"""Golden calibrations for crates/relight-capture/tests/golden/calibration.json.

    pip install opencv-contrib-python-headless numpy     # 5.0 or later; 5.0.0 was used
    python3 tools/golden_calibration.py > crates/relight-capture/tests/golden/calibration.json

Thirty-six cameras on a dome of 0.6 m around a board of 12x9 squares see its corners with noise of 0.05 pixels (those inside the picture).
For each, the true camera-to-board pose; and what cv2.calibrateCamera (k1 k2 p1 p2; k3 held at zero) makes of the very same corners.
"""
import json
import sys

import cv2
import numpy as np

WIDTH, HEIGHT = 1440, 1080
MATRIX = np.array([[2321.0, 0, 868.0], [0, 2388.0, 454.0], [0, 0, 1]])
DISTORTION = np.array([-0.11, 0.14, 0.0011, -0.0007, 0.0])
COLUMNS, ROWS, SQUARE = 12, 9, 0.027
VIEWS, RADIUS, NOISE = 36, 0.6, 0.05


def main():
    rng = np.random.default_rng(5)
    codes = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE, 0.75 * SQUARE, codes)
    corners = board.getChessboardCorners().astype(float)
    middle = np.array([COLUMNS, ROWS, 0]) * SQUARE / 2
    views, points, pixels = [], [], []
    while len(views) < VIEWS:
        azimuth, colatitude = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(5, 60))
        out = np.array([np.sin(colatitude) * np.cos(azimuth), np.sin(colatitude) * np.sin(azimuth), -np.cos(colatitude)])
        centre = middle + RADIUS * out
        forward = middle + [*rng.uniform(-0.03, 0.03, 2), 0] - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, -1.0])
        right /= np.linalg.norm(right)
        roll = rng.uniform(-0.3, 0.3)
        down = np.cross(forward, right)
        right, down = np.cos(roll) * right + np.sin(roll) * down, np.cos(roll) * down - np.sin(roll) * right
        R = np.stack([right, down, forward])
        seen = cv2.projectPoints(corners, cv2.Rodrigues(R)[0], -R @ centre, MATRIX, DISTORTION)[0].reshape(-1, 2)
        seen = (seen + rng.normal(0, NOISE, seen.shape)).round(3)
        inside = (seen > 0).all(1) & (seen < [WIDTH - 1, HEIGHT - 1]).all(1)
        ids = np.flatnonzero(inside)
        points.append(corners[ids].astype(np.float32))
        pixels.append(seen[ids].astype(np.float32))
        pose = np.c_[R.T, centre]
        views.append(dict(corners=[[int(i), *seen[i].tolist()] for i in ids], truth=pose.round(9).tolist()))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 300, 1e-15)
    result = cv2.calibrateCameraExtended(points, pixels, (WIDTH, HEIGHT), None, None,
                                        flags=cv2.CALIB_FIX_K3, criteria=criteria)
    rms, matrix, distortion, rotations, translations, deviations = result[:6]
    for view, rotation, translation in zip(views, rotations, translations):
        R = cv2.Rodrigues(rotation)[0]
        view['opencv'] = np.c_[R.T, -R.T @ translation].round(9).tolist()
    opencv = dict(rms=rms, intrinsics=[matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion.ravel().tolist()],
                  deviations=deviations.ravel()[:9].tolist())
    truth = [MATRIX[0, 0], MATRIX[1, 1], MATRIX[0, 2], MATRIX[1, 2], *DISTORTION.tolist()]
    json.dump(dict(opencv_version=cv2.__version__, width=WIDTH, height=HEIGHT, columns=COLUMNS, rows=ROWS, square=SQUARE,
                   marker=0.75 * SQUARE, dictionary='DICT_5X5_100', noise=NOISE, truth=truth, opencv=opencv, views=views),
              sys.stdout, separators=(',', ':'))
    print()
    print('OpenCV', rms, opencv['intrinsics'], file=sys.stderr)
    print('deviations', opencv['deviations'], file=sys.stderr)


if __name__ == '__main__':
    main()
