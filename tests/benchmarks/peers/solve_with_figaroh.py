"""Calibrate an arm with FIGAROH and print seconds and residuals as one JSON line.

Run by the interpreter of an environment of its own (``pip install figaroh``):
``python solve_with_figaroh.py PROBLEM.npz ARM.urdf [--repeats 3] [--elastic] [--gravity X Y Z]``.

``PROBLEM.npz`` holds ``q`` (n, joints) [rad] and ``positions`` (n, 3) [m]; the URDF is the nominal
arm. Where it holds ``held_out`` (m, joints) [rad] too, the tips that the calibrated model predicts
there are reported (m, 3) [m].

What is called is the way of the package's documentation: a subclass of ``BaseCalibration`` with a
cost function of its own, ``initialize()``, then ``solve_optimisation()``. Level ``full_params``,
tip unknown, positions measured, every other option at its default but one: of the methods of
``scipy.optimize.least_squares`` that it hands on, ``trf`` takes fewer evaluations here than its
default ``lm`` (three quarters of the time, the same minimum); derivatives are differences in both.
The cost function is the shortest that its documentation allows: measured minus predicted positions,
without the loops over samples of ``_compute_logmap_residuals``; for positions the sum of squares is
the same. ``initialize()`` (which chooses the parameters), and the reports that ``solve()`` adds,
are outside the clock; ``initialize()`` has its own.

The base frame is called known: the 27 parameters of a 6R arm then move the base too, through the
placement of joint 1. Called unknown, the six names of the base would overwrite the first six
parameters by position, whatever these are.

``--elastic`` is its option ``include_non_geometric``: one stiffness parameter ``k_RZ`` a joint
beside the geometry. Its model turns the joint by ``k_RZ`` times the torque that holds the weight,
which pulls the other way, so the compliance is ``-k_RZ`` [rad/(N·m)]; that is reported, with the
standard uncertainty that the Jacobian and the residuals at the minimum give. It needs masses in the
URDF and the gravity of the mount, which a URDF cannot say: ``--gravity`` [m/s²].
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import logging
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


def main() -> None:
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("problem")
    arguments.add_argument("urdf")
    arguments.add_argument("--repeats", type=int, default=3)
    arguments.add_argument("--elastic", action="store_true")
    arguments.add_argument("--gravity", type=float, nargs=3, default=[0.0, 0.0, -9.81])
    given = arguments.parse_args()
    logging.disable(logging.WARNING)
    with np.load(given.problem) as problem:
        q, positions, held_out = problem["q"], problem["positions"], problem.get("held_out")
    with contextlib.redirect_stdout(sys.stderr), tempfile.TemporaryDirectory() as folder:
        report = solve(q, positions, held_out, given, Path(folder))
    print(json.dumps(report))


def solve(
    q: np.ndarray,
    positions: np.ndarray,
    held_out: np.ndarray | None,
    given: argparse.Namespace,
    folder: Path,
) -> dict[str, object]:
    from figaroh.calibration.base_calibration import BaseCalibration
    from figaroh.calibration.calibration_tools import calc_updated_fkm
    from figaroh.tools.load_robot import load_robot

    class PositionCalibration(BaseCalibration):
        def cost_function(self, var: np.ndarray) -> np.ndarray:
            predicted = calc_updated_fkm(
                self.model, self.data, var, self.q_measured, self.calib_config
            )
            return self.PEE_measured - predicted

    seconds, initialising = [], []
    for _ in range(given.repeats):
        robot = load_robot(given.urdf, package_dirs=str(Path(given.urdf).parent))
        robot.model.gravity.linear = np.array(given.gravity)
        config = write_input(folder, list(robot.model.names[1:]), q, positions, given.elastic)
        calibration = PositionCalibration(robot, str(config))
        calibration.calib_config |= {"known_baseframe": True, "known_tipframe": False}
        start = time.process_time()
        calibration.initialize()
        initialising.append(time.process_time() - start)
        nominal = np.zeros(len(calibration.calib_config["param_name"]))
        before = rms(calibration.cost_function(nominal))
        start = time.process_time()
        result, _ = calibration.solve_optimisation(method="trf")
        seconds.append(time.process_time() - start)
    report: dict[str, object] = {
        "package": "figaroh",
        "version": importlib.metadata.version("figaroh"),
        "seconds": min(seconds),
        "seconds_initialize": min(initialising),
        "parameters": len(result.x),
        "records": len(q),
        "rms_before_m": before,
        "rms_after_m": rms(calibration.cost_function(result.x)),
        "evaluations": int(result.nfev),
        "converged": bool(result.success),
        "names": calibration.calib_config["param_name"],
    }
    if given.elastic:
        report["compliance_rad_per_nm"] = compliances(
            calibration.calib_config["param_name"], result
        )
    if held_out is not None:
        there = calibration.calib_config | {"NbSample": len(held_out)}
        predicted = calc_updated_fkm(calibration.model, calibration.data, result.x, held_out, there)
        report["predicted_m"] = predicted.reshape(3, -1).T.tolist()
    return report


def compliances(names: list[str], result: object) -> dict[str, tuple[float, float]]:
    """By joint (its number as text): compliance and standard uncertainty [rad/(N·m)]."""
    variance = np.sum(result.fun**2) / (len(result.fun) - len(result.x))
    u = np.sqrt(np.diag(np.linalg.pinv(result.jac.T @ result.jac)) * variance)
    rows = zip(names, result.x, u, strict=True)
    return {
        name.removeprefix("k_RZ_joint"): (-float(k), float(s))
        for name, k, s in rows
        if name.startswith("k_RZ")
    }


def write_input(
    folder: Path, joints: list[str], q: np.ndarray, positions: np.ndarray, elastic: bool
) -> Path:
    """Write the measurements (CSV) and the configuration (YAML, unified format) that
    FIGAROH reads.
    """
    import pandas as pd
    import yaml

    table = pd.DataFrame(positions, columns=["x1", "y1", "z1"]).join(
        pd.DataFrame(q, columns=joints)
    )
    table.to_csv(folder / "data.csv", index=False)
    calibration = {
        "type": "kinematic_calibration",
        "kinematics": {"base_frame": "universe", "tool_frame": "tip"},
        "joints": {"active_joints": joints},
        "parameters": {"calibration_level": "full_params", "include_non_geometric": elastic},
        "measurements": {"markers": [{"measurable_dof": [True, True, True, False, False, False]}]},
        "data": {"source_file": str(folder / "data.csv"), "number_of_samples": len(q)},
    }
    config = folder / "config.yaml"
    config.write_text(
        yaml.safe_dump({"robot": {"name": "arm"}, "tasks": {"calibration": calibration}})
    )
    return config


def rms(residual: np.ndarray) -> float:
    """Root mean square of all 3 n coordinates of the residual [m]."""
    return math.sqrt(np.mean(residual**2))


if __name__ == "__main__":
    main()
