"""Every number that the commands write for fixed inputs, so that a change which should change none can be held to it.

``python -m tests.kept_numbers NUMBERS.json`` runs all commands, and with two such files lists what differs.
``python -m tests.kept_numbers few`` writes anew the few that a test holds, in ``kept_numbers.json``.
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

NOISE = "--encoder-noise-rad 8e-6 --reference-noise-mm 0.012"
AT_SEATS = "--encoder-noise-rad 8e-6 --reference-noise-mm 0.01 --probe-noise-mm 0.005"
FREE, SEATS = "simulate sino6 --plan free", "simulate sino6 --plan seats --records 120"
POINT = "--point 33.6323 -671.8702 182.9355"
FEW = [
    "urdf sino6 -o sino6.urdf",
    f"configurations sino6 {POINT} --count 24 -o circle.csv",
    f"accuracy sino6 {POINT} --count 24 --json accuracy.json",
    "map sino6 --cells 5 5 --sectors 4 -o map.nc --json map.json",
    f"{FREE} --records 60 --effect encoder_eccentricity:joint=3,amplitude_rad=3e-4 --seed 1 -o free.csv",
    f"calibrate sino6 free.csv {NOISE} -o calibrated.toml --json calibrate.json",
    f"diagnose sino6 free.csv {NOISE} --json diagnose.json --extended-arm extended.toml",
    "correct extended.toml free.csv -o corrected.csv",
    "plan sino6 --split encoder_gain:3 encoder_eccentricity:3 --records 12 -o plan.csv --json plan.json",
]
"""A command of each kind; the later ones use what the earlier ones wrote."""
MORE = [
    "urdf zero6 -o zero6.urdf",
    "configurations sino6 --tip --point 500 200 400 --axis 0 0 -1 --count 12 -o axis.csv",
    *(f"accuracy sino6 {POINT} --count 24 --method {m} --json {m}.json" for m in ("jointwise", "ellipsoid", "monte-carlo")),
    f"{SEATS} --effect bearing_tilt:joint=2,compliance_rad_per_nm=2e-6 --seed 2 -o seats.csv",
    f"{FREE} --records 300 --perturb --effect thermal_expansion:expansion_per_k=2e-5 --seed 3 -o warm.csv",
    f"{FREE} --records 80 --seed 4 -o nothing.csv",
    f"calibrate sino6 seats.csv {AT_SEATS} --json seats-calibrate.json -o seats.toml",
    f"calibrate sino6 warm.csv {NOISE} --reference-frame external --json external.json --urdf-out external.urdf",
    f"calibrate sino6 nothing.csv {NOISE} --parameters zero-offsets --json zero.json --residuals residuals.csv",
    f"diagnose sino6 seats.csv {AT_SEATS} --json seats-diagnose.json",
    f"diagnose sino6 warm.csv {NOISE} --reference-frame external --json warm-diagnose.json --extended-arm warm.toml",
    f"diagnose sino6 nothing.csv {NOISE} --json nothing-diagnose.json",
    "diagnose sino6 free.csv --json unstated.json",
    "correct seats.toml seats.csv -o seats-corrected.csv",
    f"plan sino6 --data warm.csv {NOISE} --records 10 -o best.csv --json best.json",
]
KEPT = Path(__file__).with_suffix(".json")
OTHERWISE = {"seconds", "version", "source", "commit", "date"}
"""Keys whose values may differ from run to run."""


def numbers_of(commands: list[str]) -> dict[str, float]:
    """Runs the commands in one new folder; every number of every file they write, by file and place in it."""
    with TemporaryDirectory() as name, contextlib.chdir(name):
        for command in tqdm(commands, unit="command"):
            done = CliRunner().invoke(app, command.split())
            if done.exit_code != 0:
                raise RuntimeError(f"aacmm-pin {command}: exit status {done.exit_code}\n{done.output}") from done.exception
        return {f"{p.name}/{place}": v for p in sorted(Path().iterdir()) for place, v in _flat(_read(p))}


def of_results(numbers: Mapping[str, float]) -> dict[str, float]:
    """Without tables of records and postures, rounded so that they do not fill the page."""
    return {place: float(f"{v:.10g}") for place, v in numbers.items() if place.split("/")[0].endswith((".json", ".toml"))}


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
            return [[e.tag, {k: _words(v) for k, v in e.attrib.items()}] for e in ElementTree.parse(path).iter()]
    raise ValueError(path)


def _words(value: str) -> list[float | str]:
    def number(word: str) -> float | str:
        try:
            return float(word)
        except ValueError:
            return word

    return [number(word) for word in value.split()]


def _flat(value: Any, place: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if key not in OTHERWISE:
                yield from _flat(inner, f"{place}.{key}" if place else str(key))
    elif isinstance(value, list | tuple):
        for k, inner in enumerate(value):
            yield from _flat(inner, f"{place}[{k}]")
    elif isinstance(value, bool | int | float):
        yield place, float(value)


def differences(old: Mapping[str, float], new: Mapping[str, float], relative: float) -> list[str]:
    """What one has and the other lacks, and numbers that differ by more than ``relative`` of the larger."""
    found = [f"- {place}" for place in old.keys() - new.keys()] + [f"+ {place}" for place in new.keys() - old.keys()]
    for place in old.keys() & new.keys():
        a, b = old[place], new[place]
        if not (math.isclose(a, b, rel_tol=relative, abs_tol=1e-12) or (math.isnan(a) and math.isnan(b))):
            found.append(f"{place}: {a!r} {b!r}")
    return sorted(found)


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
