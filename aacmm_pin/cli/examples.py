"""Two examples of each command, which stand under its help."""

from __future__ import annotations

from collections.abc import Mapping

EXAMPLES: Mapping[str, tuple[str, str]] = {
    "accept": (
        "aacmm-pin accept probed.csv --mpe E_Uni=0.1 -o report.html",
        "aacmm-pin accept --predict my_arm.toml plan.csv --encoder-noise-rad 8e-6",
    ),
    "accuracy": (
        "aacmm-pin accuracy sino6 --point 400 0 300 --encoder-noise-rad 8e-6",
        "aacmm-pin accuracy sino6 --point 400 0 300 --to 400 300 300",
    ),
    "calibrate": (
        "aacmm-pin calibrate my_arm.toml data.csv --encoder-noise-rad 8e-6 -o calibrated.toml",
        "aacmm-pin calibrate --urdf robot.urdf --frame tool0 data.csv --reference-frame external",
    ),
    "causes": ("aacmm-pin causes", "aacmm-pin causes encoder_eccentricity"),
    "configurations": (
        "aacmm-pin configurations sino6 --point 400 0 300 -o postures.csv",
        "aacmm-pin configurations sino6 --point 400 0 300 --tip --axis 0 0 -1",
    ),
    "correct": (
        "aacmm-pin correct calibrated.toml readings.csv -o corrected.csv",
        "aacmm-pin correct calibrated.toml path.csv --commands --nominal ur5",
    ),
    "demo": ("aacmm-pin demo -o out/", "aacmm-pin demo -o out/ --force"),
    "diagnose": (
        "aacmm-pin diagnose my_arm.toml data.csv --encoder-noise-rad 8e-6 -o report.html",
        "aacmm-pin diagnose my_arm.toml data.csv --arm-out extended.toml --with-discrepancy",
    ),
    "map": (
        "aacmm-pin map sino6 --cells 24 24 --sectors 12 -o map.nc --plot map.png",
        "aacmm-pin map my_arm.toml --workers 4 -o map.nc",
    ),
    "plan": (
        "aacmm-pin plan my_arm.toml --for calibration --records 60 -o plan.csv --sheet plan.html",
        "aacmm-pin plan sino6 --distinguish encoder_gain:3 encoder_eccentricity:3 -o plan.csv",
    ),
    "show": (
        "aacmm-pin show sino6 --point 400 0 300 -o scene.html",
        'aacmm-pin show ur5 --theta-deg "0 -60 90 -90 0 0"',
    ),
    "simulate": (
        "aacmm-pin simulate sino6 --plan free --records 200 --random-geometry -o data.csv",
        "aacmm-pin simulate sino6 --plan seats --cause joint_compliance:2,"
        "compliance_rad_per_nm=2e-5 -o data.csv",
    ),
    "urdf": ("aacmm-pin urdf sino6 -o sino6.urdf", "aacmm-pin urdf --to-dh ur5 -o ur5.toml"),
}


def examples_of(command: str) -> str:
    """The examples of a command, line by line as they stand."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in EXAMPLES[command])])
