"""Calibrate an arm with robotkinecal and print seconds and residuals as one JSON line.

Run by the interpreter of an environment of its own (``pip install robotkinecal``):
``python solve_with_robotkinecal.py PROBLEM.npz ARM.urdf [--repeats 3]``.

``PROBLEM.npz`` holds ``q`` (n, joints) [rad] and ``positions`` (n, 3) [m]; the URDF is the nominal
arm, every joint about z.

What is called is the way of the package's README for positions: ``SerialRobotKineCal(robot,
ee_name)``, ``set_observations`` with points, ``solve()`` with its defaults (Gauss-Newton on the
screw axes of the product of exponentials, four parameters a joint and three of the tip; it ends
when the norm of all errors moves by less than 1e-4). The clock (CPU time) runs for ``solve()``
alone.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import math
import sys
import time
import warnings

import numpy as np


def main() -> None:
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("problem")
    arguments.add_argument("urdf")
    arguments.add_argument("--repeats", type=int, default=3)
    given = arguments.parse_args()
    with np.load(given.problem) as problem:
        q, positions = problem["q"], problem["positions"]
    # The package prints its warnings; stdout is for the one line.
    with contextlib.redirect_stdout(sys.stderr):
        report = solve(q, positions, given.urdf, given.repeats)
    print(json.dumps(report))


def solve(q: np.ndarray, positions: np.ndarray, urdf: str, repeats: int) -> dict[str, object]:
    import roboticstoolbox as rtb
    from robotkinecal import SerialRobotKineCal

    seconds = []
    for repeat in range(repeats):
        with warnings.catch_warnings():
            # Robot.URDF() is what its README calls.
            warnings.simplefilter("ignore", DeprecationWarning)
            robot = rtb.ERobot.URDF(urdf)
        np.random.seed(repeat)  # noqa: NPY002 - its basis of every axis starts from numpy's global generator
        # A new one each time: solve() moves the axes it holds.
        calibration = SerialRobotKineCal(robot, "tip")
        calibration.set_observations(list(q), list(positions))
        before = rms(calibration, q, positions)
        start = time.process_time()
        result = calibration.solve()
        seconds.append(time.process_time() - start)
    return {
        "package": "robotkinecal",
        "version": importlib.metadata.version("robotkinecal"),
        "seconds": min(seconds),
        "parameters": calibration.N_PARAMS,
        "records": len(q),
        "rms_before_m": before,
        "rms_after_m": rms(calibration, q, positions),
        "iterations": result.nb_iterations_executed,
        "converged": result.has_converged,
    }


def rms(calibration: object, q: np.ndarray, positions: np.ndarray) -> float:
    """Root mean square of all 3 n coordinates of the residual [m]."""
    last = calibration.N_JOINTS + 1
    predicted = np.array([calibration.forward_kinematics(last, row).t for row in q])
    return math.sqrt(np.mean((positions - predicted) ** 2))


if __name__ == "__main__":
    main()
