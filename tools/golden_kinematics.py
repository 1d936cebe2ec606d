#!/usr/bin/env python3
"""Golden values of arms' kinematics for crates/relight-capture/tests/golden/kinematics.json.

    pip install ur-analytic-ik robotkinematicscatalogue numpy        # 0.1.0.post3 and 1.1.2 were used
    python3 tools/golden_kinematics.py > crates/relight-capture/tests/golden/kinematics.json

For the UR5e: joints, the flange's pose and all inverse solutions, by ur-analytic-ik. For the EC66: joints and the flange's
pose, by robotkinematicscatalogue (whose inverse is left alone: it returns wrong solutions among right ones). Joints in
radians, poses row by row in metres.
"""
import importlib
import json
import sys

import numpy as np
import ur_analytic_ik

CATALOGUE = "robotkinematicscatalogue.inversekinematics.__6DOF.__collaborativeRobots.Elite_Robots_EC66"
COUNT = 30


def main():
    rng = np.random.default_rng(11)
    ec66 = importlib.import_module(CATALOGUE).Elite_Robots_EC66()
    cases = {"ur5e": [], "ec66": []}
    for _ in range(COUNT):
        joints = rng.uniform(-np.pi, np.pi, 6)
        pose = ur_analytic_ik.ur5e.forward_kinematics(*joints)
        solutions = [s.reshape(-1).tolist() for s in ur_analytic_ik.ur5e.inverse_kinematics(pose)]
        cases["ur5e"].append({"joints": joints.tolist(), "pose": pose.reshape(-1).tolist(), "solutions": solutions})
    for _ in range(COUNT):
        joints = rng.uniform(-np.pi, np.pi, 6)
        pose = np.array(ec66.FK(joints.tolist()))
        pose[:3, 3] /= 1000.0
        cases["ec66"].append({"joints": joints.tolist(), "pose": pose.reshape(-1).tolist(), "solutions": []})
    json.dump(cases, sys.stdout)
    print()


if __name__ == "__main__":
    main()
