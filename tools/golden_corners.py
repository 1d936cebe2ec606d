#!/usr/bin/env python3
"""Golden pictures of ChArUco boards and their corners for crates/relight-capture/tests/golden/corners/.

    pip install opencv-contrib-python-headless numpy     # 5.0 or later: 4.6 places corners half a pixel off; 5.0.0 was used
    python3 tools/golden_corners.py crates/relight-capture/tests/golden/corners
    python3 tools/golden_corners.py FOLDER --random 200   # not shipped: as many random pictures, to try more

Each picture shows the board that OpenCV draws (CharucoBoard.generateImage) through a pinhole camera with a lens: every pixel is the
mean of 8x8 rays, then blurred, exposed, given noise and clipped. corners.json lists for each picture the board, the true
corners (cv2.projectPoints, those inside the picture) and what cv2.aruco.CharucoDetector finds, and for each board OpenCV's
corners in the board's frame.
"""
import argparse
import json
from pathlib import Path

import cv2
import numpy as np

SQUARE = 0.03
BOARDS = {
    'small': (7, 5, 'DICT_4X4_50'),
    'large': (11, 8, 'DICT_5X5_100'),
    'april': (6, 9, 'DICT_APRILTAG_36h11'),
}
SAMPLES = 8
# Of random pictures, which are larger and have more blur.
FEWER_SAMPLES = 4


def make_board(name):
    columns, rows, dictionary = BOARDS[name]
    cells = int(dictionary[5]) + 2 if dictionary[5].isdigit() else 8
    marker = 0.75 * SQUARE
    codes = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    board = cv2.aruco.CharucoBoard((columns, rows), SQUARE, marker, codes)
    # Three quarters of a square are whole pixels, and whole pixels a marker cell: nothing is rounded.
    square = 4 * cells * 5
    drawn = board.generateImage((columns * square, rows * square), marginSize=0, borderBits=1)
    return board, drawn, square


def render(board_name, pose, lens, size, look, rng, samples=SAMPLES):
    """The picture, and where the corners truly are."""
    board, drawn, square = make_board(board_name)
    (matrix, distortion), (width, height) = lens, size
    rotation, translation = pose
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    u = (np.arange(width)[:, None] + offsets).ravel()
    v = (np.arange(height)[:, None] + offsets).ravel()
    pixels = np.stack(np.meshgrid(u, v), -1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(pixels, matrix, distortion).reshape(-1, 2)
    rays = np.c_[rays, np.ones(len(rays))]
    R = cv2.Rodrigues(rotation)[0]
    origin, ahead = -R.T @ translation, rays @ R
    on_board = origin[:2] - ahead[:, :2] * (origin[2] / ahead[:, 2])[:, None]
    cell = np.floor(on_board / SQUARE * square).astype(int)
    inside = ((cell >= 0) & (cell < [drawn.shape[1], drawn.shape[0]])).all(1)
    clipped = np.clip(cell, 0, [drawn.shape[1] - 1, drawn.shape[0] - 1])
    margin = ((on_board > -SQUARE / 2) & (on_board < np.array([drawn.shape[1], drawn.shape[0]]) / square * SQUARE + SQUARE / 2)).all(1)
    paper = np.where(margin, 255.0, 90.0)
    value = np.where(inside, drawn[clipped[:, 1], clipped[:, 0]], paper)
    picture = value.reshape(height, samples, width, samples).mean((1, 3))
    black, white, blur, noise = look
    picture = cv2.GaussianBlur(picture, (0, 0), blur) if blur else picture
    picture = black + (white - black) * picture / 255 + rng.normal(0, noise, picture.shape)
    picture = np.clip(np.round(picture), 0, 255).astype(np.uint8)
    truth = cv2.projectPoints(board.getChessboardCorners(), rotation, translation, matrix, distortion)[0].reshape(-1, 2)
    return picture, truth, board


def pose_of(board_name, tilt, spin, turn, distance, aside=(0.0, 0.0)):
    """A camera that looks at the board's middle (aside by metres) from `distance`, `tilt` degrees off the normal."""
    columns, rows, _ = BOARDS[board_name]
    middle = np.array([columns, rows, 0]) * SQUARE / 2 + [*aside, 0]
    radians = np.radians([tilt, spin, turn])
    tilted = cv2.Rodrigues(np.array([np.cos(radians[1]), np.sin(radians[1]), 0]) * radians[0])[0]
    turned = cv2.Rodrigues(np.array([0, 0, radians[2]]))[0]
    R = turned @ tilted
    return cv2.Rodrigues(R)[0].ravel(), np.array([0, 0, distance]) - R @ middle


def lens_of(focal, size, distortion=(0, 0, 0, 0, 0)):
    return np.array([[focal, 0, size[0] / 2 - 3.3], [0, focal * 1.02, size[1] / 2 + 2.1], [0, 0, 1]]), np.array(distortion, float)


def fixed():
    plain, larger, bent = (320, 240), (400, 300), (-0.2, 0.1, 0.001, -0.0015, 0.02)
    yield 'frontal', 'small', pose_of('small', 4, 30, 3, 0.44), lens_of(560, plain), plain, (30, 220, 0.8, 0.3)
    yield 'tilted', 'small', pose_of('small', 35, 70, 25, 0.45), lens_of(560, plain, bent), plain, (25, 210, 1.1, 1)
    yield 'steep', 'small', pose_of('small', 60, 20, 100, 0.36), lens_of(700, plain), plain, (20, 200, 0.9, 0.3)
    yield 'partial', 'small', pose_of('small', 25, 200, 40, 0.30, (0.055, 0.03)), lens_of(560, plain), plain, (30, 220, 0.9, 0.3)
    yield 'dark', 'small', pose_of('small', 20, 120, -15, 0.42), lens_of(560, plain), plain, (4, 44, 0.8, 0.3)
    yield 'overexposed', 'small', pose_of('small', 28, 300, 170, 0.42), lens_of(560, plain), plain, (60, 330, 1.0, 0.3)
    yield 'large', 'large', pose_of('large', 30, 250, 15, 0.60), lens_of(590, larger, bent), larger, (25, 215, 0.8, 0.3)
    yield 'april', 'april', pose_of('april', 25, 45, 75, 0.47), lens_of(600, larger), larger, (25, 215, 0.8, 0.3)


def random(count, rng):
    size = (720, 540)
    for i in range(count):
        board = list(BOARDS)[i % 3]
        tilt, spin, turn = rng.uniform(0, 60), rng.uniform(0, 360), rng.uniform(-180, 180)
        aside = rng.uniform(-0.12, 0.12, 2) if i % 4 == 0 else rng.uniform(-0.01, 0.01, 2)
        lens = lens_of(1180, size, (rng.uniform(-0.2, 0.1), rng.uniform(-0.1, 0.1), *rng.uniform(-0.002, 0.002, 2), 0))
        black, white = (rng.uniform(2, 15), rng.uniform(30, 90)) if i % 5 == 0 else (rng.uniform(10, 60), rng.uniform(150, 300))
        look = (black, white, rng.uniform(0.4, 1.6), rng.uniform(0, 2.5))
        yield f'{i:04}', board, pose_of(board, tilt, spin, turn, rng.uniform(0.4, 0.7), aside), lens, size, look


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('folder', type=Path)
    parser.add_argument('--random', type=int)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(11)
    cases = []
    for name, board_name, pose, lens, size, look in random(arguments.random, rng) if arguments.random else fixed():
        samples = FEWER_SAMPLES if arguments.random else SAMPLES
        picture, truth, board = render(board_name, pose, lens, size, look, rng, samples)
        # Above 100: without loss.
        cv2.imwrite(str(arguments.folder / f'{name}.webp'), picture, [cv2.IMWRITE_WEBP_QUALITY, 101])
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(picture)
        found = {} if ids is None else dict(zip(ids.ravel().tolist(), corners.reshape(-1, 2).astype(float).round(4).tolist()))
        inside = {i: p.round(5).tolist() for i, p in enumerate(truth) if (p > -0.5).all() and (p < np.array(size) - 0.5).all()}
        cases.append(dict(image=f'{name}.webp', board=board_name, truth=inside, opencv=found))
        misses = np.array([np.subtract(found[i], truth[i]) for i in found])
        rms = np.sqrt((misses ** 2).sum(1).mean()) if len(misses) else np.nan
        print(f'{name}: {len(found)} of {len(inside)} corners, OpenCV {rms:.4f} px RMS from the truth')
    boards = {}
    for name, (columns, rows, dictionary) in BOARDS.items():
        board = make_board(name)[0]
        boards[name] = dict(columns=columns, rows=rows, square=SQUARE, marker=0.75 * SQUARE, dictionary=dictionary,
                            corners=board.getChessboardCorners().astype(float).round(6).tolist())
    with open(arguments.folder / 'corners.json', 'w') as file:
        json.dump(dict(opencv=cv2.__version__, boards=boards, cases=cases), file, separators=(',', ':'))
        file.write('\n')


if __name__ == '__main__':
    main()
