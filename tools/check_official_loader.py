#!/usr/bin/env python3
"""Reads a captured scene with the official loader of the ReNe dataset, and compares what it gives with the files.

    pip install pipelime-python rich opencv-python-headless      # 3.0.0, 15.0.0 and 5.0.0 were used
    git clone https://github.com/eyecan-ai/rene                   # 1290c4f was used
    relight capture run --object fern --size 160x120 --views 4 --lights 3 --samples 4 --out /tmp/fern
    PYTHONPATH=rene python3 tools/check_official_loader.py /tmp/fern

The loader takes every entry of a scene's folder for the set of a light, and knows scenes by the names of the published ones
alone. It is therefore given a folder with links to the `lsetNNN` of the scene, under such a name. Whether it could have
read the scene's own folder is said too. Prints a line for each thing tried and fails at the first that goes wrong.
"""
import os
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from pipelime.sequences import SamplesSequence
from rene.utils.loaders import ReneDataset
from rene.utils.stages import ResizeStage

NAME = "apple"


def check(what, condition, value=""):
    print(f"{'ok' if condition else 'WRONG'}  {what} {value}")
    if not condition:
        sys.exit(1)


def load(scene, parent):
    """Samples by light; images are read when they are asked for, so that `parent` has to stay until then."""
    os.symlink(scene.resolve(), Path(parent) / NAME)
    return ReneDataset(input_folder=Path(parent))[NAME]


def main():
    scene = Path(sys.argv[1])
    lights = sorted(scene.glob("lset*"))
    check("light sets", len(lights) > 0, len(lights))
    for light, folder in enumerate(lights):
        views = sorted((folder / "data").glob("*_image.png"))
        samples = SamplesSequence.from_underfolder(folder)
        check(f"{folder.name}: samples", len(samples) == len(views), len(samples))
        for view, sample in enumerate(samples):
            expected = cv2.cvtColor(cv2.imread(str(views[view])), cv2.COLOR_BGR2RGB)
            pose = np.loadtxt(folder / "data" / f"{view:05}_pose.txt")
            same = (
                sorted(sample.keys()) == ["camera", "image", "light", "pose"]
                and np.array_equal(sample["image"](), expected)
                and np.array_equal(sample["pose"](), pose)
                and np.array_equal(sample["light"](), np.loadtxt(folder / "light.txt"))
                and sample["camera"]()["intrinsics"]["image_size"] == [expected.shape[1], expected.shape[0]]
                and np.shape(sample["camera"]()["intrinsics"]["camera_matrix"]) == (3, 3)
            )
            check(f"{folder.name}: view {view}", same)
            # What the loader does to each sample: a change of size, of image and lens.
            resized = ResizeStage(target_size=(64, 48))(sample)
            check(f"{folder.name}: view {view} resized", resized["image"]().shape == (48, 64, 3))
    with tempfile.TemporaryDirectory() as bare, tempfile.TemporaryDirectory() as parent:
        for folder in lights:
            os.symlink(folder.resolve(), Path(bare) / folder.name)
        dataset = load(Path(bare), parent)
        check("ReneDataset: light sets", len(dataset) == len(lights), len(dataset))
        sample = dataset[-1][0]
        check("ReneDataset: keys", {"camera", "image", "light", "pose", "thumb"} <= set(sample.keys()), list(sample.keys()))
        check("ReneDataset: image", sample["image"]().shape == (1080, 1440, 3), sample["image"]().shape)
    beside = sorted(entry.name for entry in scene.iterdir() if not entry.name.startswith("lset"))
    try:
        with tempfile.TemporaryDirectory() as parent:
            load(scene, parent)
        print("ok  ReneDataset on the scene's own folder")
    except Exception as error:
        print(f"note  ReneDataset does not read the scene's own folder, for {', '.join(beside)} beside the light sets:")
        print(f"      {str(error).splitlines()[-2].strip()}")


main()
