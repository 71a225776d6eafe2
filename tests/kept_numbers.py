"""Every number and every name that the commands write for fixed inputs, so that a change is held to
those it should keep.

``python -m tests.kept_numbers NUMBERS.json`` runs all commands, and with two such files lists what
differs. ``python -m tests.kept_numbers few`` writes anew the few that a test holds, in
``kept_numbers.json``.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

os.environ["OMP_NUM_THREADS"] = "1"  # before NumPy comes: the order of sums depends on it

import pandas as pd
import xarray as xr
from tqdm import tqdm
from typer.testing import CliRunner

from aacmm_pin.cli.root_command import app

NOISE = "--encoder-noise 8e-6 --u-reference-mm 0.012"
AT_SEATS = "--encoder-noise 8e-6 --u-reference-mm 0.01 --probe-noise-mm 0.005"
FREE, SEATS = "simulate sino6 --scheme free", "simulate sino6 --scheme seats --records 120"
BARS = "simulate sino6 --scheme ball-bar --seats 4 --records 90 --bar-length-mm 400"
TOUCHED = "--encoder-noise 8e-6 --probe-noise-mm 0.005"
AT_BARS = "--encoder-noise 8e-6 --probe-noise-mm 0.005 --u-bar-mm 0.002"
HALF_WIDTHS = "--translation-half-width-mm 0.5 --rotation-half-width 1e-3"
POINT = "--point 33.6323 -671.8702 182.9355"
FEW = [
    "urdf sino6 -o sino6.urdf",
    f"configurations sino6 {POINT} --samples 24 -o circle.csv",
    f"accuracy sino6 {POINT} --samples 24 --json accuracy.json",
    "map sino6 --cells 5 5 --sectors 4 -o map.nc --json map.json",
    f"{FREE} --records 60 --cause encoder_eccentricity:joint=3,amplitude_rad=3e-4 --seed 1 -o "
    "free.csv",
    f"calibrate sino6 free.csv {NOISE} -o calibrated.toml --json calibrate.json",
    f"diagnose sino6 free.csv {NOISE} --json diagnose.json --arm-out extended.toml",
    "correct extended.toml free.csv -o corrected.csv",
    "plan distinguish sino6 --causes encoder_gain:3 encoder_eccentricity:3 --records 12 "
    "-o plan.csv --json plan.json",
]
"""A command of each kind; the later ones use what the earlier ones wrote."""
MORE = [
    "urdf zero6 -o zero6.urdf",
    "configurations sino6 --tip --point 500 200 400 --axis 0 0 -1 --samples 12 -o axis.csv",
    *(
        f"accuracy sino6 {POINT} --samples 24 --method {m} --json {m}.json"
        for m in ("jointwise", "ellipsoid", "monte-carlo")
    ),
    f"{SEATS} --cause bearing_tilt:joint=2,compliance_rad_per_nm=2e-6 --seed 2 -o seats.csv",
    f"{FREE} --records 300 --random-geometry --cause thermal_expansion:expansion_per_k=2e-5 "
    "--seed 3 -o warm.csv",
    f"{FREE} --records 80 --seed 4 -o nothing.csv",
    f"calibrate sino6 seats.csv {AT_SEATS} --json seats-calibrate.json -o seats.toml",
    f"calibrate sino6 warm.csv {NOISE} --reference-frame external --json external.json --urdf-out "
    "external.urdf",
    f"calibrate sino6 nothing.csv {NOISE} --parameters zero-offsets --json zero.json --residuals "
    "residuals.csv",
    f"diagnose sino6 seats.csv {AT_SEATS} --json seats-diagnose.json",
    f"diagnose sino6 warm.csv {NOISE} --reference-frame external --json warm-diagnose.json "
    "--arm-out warm.toml",
    f"diagnose sino6 nothing.csv {NOISE} --json nothing-diagnose.json",
    "diagnose sino6 free.csv --json unstated.json",
    "correct seats.toml seats.csv -o seats-corrected.csv",
    f"plan distinguish sino6 --existing warm.csv {NOISE} --records 10 -o best.csv --json best.json",
    f"plan calibration sino6 {NOISE} --records 20 --postures 300 -o geometry.csv --json "
    "geometry.json",
    "plan acceptance sino6 --measuring-range-mm 1000 -o procedure.csv",
    f"simulate sino6 --procedure procedure.csv {TOUCHED} --seed 5 -o touches.csv",
    "accept sino6 touches.csv --mpe SPAT.Max=0.15 --json accept.json",
    f"{BARS} --cause joint_compliance:3,compliance_rad_per_nm=2e-5 --seed 6 -o bars.csv",
    f"calibrate sino6 bars.csv {AT_BARS} --target unknown --json bars-calibrate.json",
    f"diagnose sino6 bars.csv {AT_BARS} --target unknown --json bars-diagnose.json",
    f"{FREE} --records 60 --orientation-noise 50urad --cause encoder_gain:2,gain=2e-4 --seed "
    "7 -o oriented.csv",
    f"diagnose sino6 oriented.csv {NOISE} --json oriented-diagnose.json",
    f"{FREE} --records 100 --cause thermal_expansion:expansion_per_k=4e-5 --seed 8 -o warmer.csv",
    f"diagnose warm.toml warmer.csv {NOISE} --reference-frame external --json changed.json",
    "correct warm.toml warmer.csv --commands --nominal sino6 -o commands.csv",
    f"diagnose sino6 free.csv {NOISE} --with-discrepancy --arm-out described.toml --json "
    "described.json",
    f"calibrate --urdf sino6.urdf --frame tip {HALF_WIDTHS} free.csv {NOISE} --json "
    "urdf-calibrate.json",
]
Value = float | str
KEPT = Path(__file__).with_suffix(".json")
NAMES = {
    "verdict",
    "doubts",
    "cause",
    "causes",
    "joint",
    "covariate",
    "depends_on",
    "kind",
    "name",
    "label",
    "unit",
    "code",
}
"""Keys of strings that are compared."""
OWN_UNITS = {"u", "standard_uncertainty_si", "covariance", "covariance_mm2"}
"""Keys of numbers that are compared however small they are."""
SMALLEST = 1e-300
"""Of p-values, whose logarithms are compared."""
OTHERWISE = {"seconds", "version", "source", "commit", "date"}
"""Keys whose values may differ from run to run."""


def numbers_of(commands: list[str]) -> dict[str, Value]:
    """Runs the commands in one new folder; every number and name in every file they write, by file
    and place in it.
    """
    with TemporaryDirectory() as name, contextlib.chdir(name):
        for command in tqdm(commands, unit="command"):
            done = CliRunner().invoke(app, command.split())
            if done.exit_code != 0:
                raise RuntimeError(
                    f"aacmm-pin {command}: exit status {done.exit_code}\n{done.output}"
                ) from done.exception
        return {
            f"{p.name}/{place}": v for p in sorted(Path().iterdir()) for place, v in _flat(_read(p))
        }


def of_results(numbers: Mapping[str, Value]) -> dict[str, Value]:
    """Without tables of records and postures, rounded so that they do not fill the page."""
    chosen = {
        place: value
        for place, value in numbers.items()
        if place.split("/")[0].endswith((".json", ".toml"))
    }
    return {place: v if isinstance(v, str) else float(f"{v:.10g}") for place, v in chosen.items()}


def _read(path: Path) -> Any:
    match path.suffix:
        case ".json":
            return json.loads(path.read_text(encoding="utf-8"))
        case ".toml":
            return tomllib.loads(path.read_text(encoding="utf-8"))
        case ".csv":
            return pd.read_csv(path).to_dict("list")
        case ".nc":
            with xr.open_dataset(path) as data:
                return {str(name): data[name].to_numpy().tolist() for name in data.variables}
        case ".urdf":
            return [
                [e.tag, {k: _words(v) for k, v in e.attrib.items()}]
                for e in ElementTree.parse(path).iter()
            ]
    raise ValueError(path)


def _words(value: str) -> list[float | str]:
    def number(word: str) -> float | str:
        try:
            return float(word)
        except ValueError:
            return word

    return [number(word) for word in value.split()]


def _flat(value: Any, place: str = "") -> Iterator[tuple[str, Value]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in OTHERWISE:
                yield from _flat(inner, f"{place}.{key}" if place else str(key))
    elif isinstance(value, list | tuple):
        for k, inner in enumerate(value):
            yield from _flat(inner, f"{place}[{k}]")
    elif isinstance(value, bool | int | float):
        yield place, float(value)
    elif isinstance(value, str) and _key(place) in NAMES:
        yield place, value


def _key(place: str) -> str:
    """The last key in a place, without numbers in lists."""
    return place.rpartition(".")[2].partition("[")[0]


def differences(old: Mapping[str, Value], new: Mapping[str, Value], relative: float) -> list[str]:
    """What one has and the other lacks, names that differ, and numbers that do by more than
    ``relative`` of the larger.
    """
    found = [f"- {place}" for place in old.keys() - new.keys()] + [
        f"+ {place}" for place in new.keys() - old.keys()
    ]
    both = ((place, old[place], new[place]) for place in old.keys() & new.keys())
    return sorted(
        found
        + [f"{place}: {a!r} {b!r}" for place, a, b in both if not _same(place, a, b, relative)]
    )


def _same(place: str, a: Value, b: Value, relative: float) -> bool:
    """Whether two values are the same; of standard uncertainties and covariances in their own
    units, however small.
    """
    if isinstance(a, str) or isinstance(b, str):
        return a == b
    if math.isnan(a) and math.isnan(b):
        return True
    if _key(place) == "p_value":
        a, b = (math.log10(max(each, SMALLEST)) for each in (a, b))
    small = 0.0 if _key(place) in OWN_UNITS else 1e-12
    return math.isclose(a, b, rel_tol=relative, abs_tol=small)


def main(words: list[str]) -> int:
    if len(words) == 2:
        old, new = (json.loads(Path(word).read_text(encoding="utf-8")) for word in words)
        found = differences(old, new, 1e-9)
        print("\n".join(found) or f"all {len(old)} numbers are the same")
        return 1 if found else 0
    kept, commands = (KEPT, FEW) if words == ["few"] else (Path(words[0]), FEW + MORE)
    numbers = numbers_of(commands)
    chosen = of_results(numbers) if kept == KEPT else numbers
    kept.write_text(json.dumps(chosen, indent=0) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
