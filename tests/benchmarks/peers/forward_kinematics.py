"""Tip positions by pybotics or ikpy, and the CPU time of the loop alone, as one JSON line.

Run by the interpreter of an environment of its own: ``python forward_kinematics.py PROBLEM.npz
ARM.urdf PACKAGE``. ``PROBLEM.npz`` holds ``q`` (n, joints) [rad] and ``rows`` (joints, 4), standard
DH: a, d, alpha, theta_offset [m, rad]. Both packages take one configuration a call. pybotics knows
modified DH: the last a and alpha become its tool.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable

import numpy as np


def by_pybotics(rows: np.ndarray, urdf: str) -> Callable[[np.ndarray], np.ndarray]:
    from pybotics.kinematic_chain import MDHKinematicChain
    from pybotics.robot import Robot
    from pybotics.tool import Tool

    a, d, alpha, theta = rows.T
    before = [np.append(0.0, x[:-1]) for x in (alpha, a)]
    chain = MDHKinematicChain.from_parameters(np.column_stack([*before, theta, d]).ravel())
    c, s = np.cos(alpha[-1]), np.sin(alpha[-1])
    tool = np.array([[1, 0, 0, a[-1]], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])
    robot = Robot(chain, Tool(matrix=tool))
    return robot.fk


def by_ikpy(rows: np.ndarray, urdf: str) -> Callable[[np.ndarray], np.ndarray]:
    from ikpy.chain import Chain

    chain = Chain.from_urdf_file(urdf, base_elements=["base_link"], symbolic=True)
    moving = [k for k, link in enumerate(chain.links) if link.joint_type == "revolute"]
    joints = np.zeros(len(chain.links))

    def fk(q: np.ndarray) -> np.ndarray:
        joints[moving] = q
        return chain.forward_kinematics(joints)

    return fk


def main() -> None:
    problem, urdf, package = sys.argv[1:]
    with np.load(problem) as arrays:
        q, rows = arrays["q"], arrays["rows"]
    fk = {"pybotics": by_pybotics, "ikpy": by_ikpy}[package](rows, urdf)
    positions = np.empty((len(q), 3))
    start = time.process_time()
    for k, angles in enumerate(q):
        positions[k] = fk(angles)[:3, 3]
    print(json.dumps({"seconds": time.process_time() - start, "positions": positions.tolist()}))


if __name__ == "__main__":
    main()
