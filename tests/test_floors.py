"""A module imports only from floors below its own; only the arm speaks to Pinocchio."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import aacmm_pin

FLOORS = {
    "blas": 0,
    "errors": 0,
    "units": 0,
    "shown": 0,
    "cells": 1,
    "checks": 1,
    "distributions": 2,
    "outputs": 1,
    "parameter": 1,
    "progress": 1,
    "angles": 2,
    "conditions": 2,
    "dh": 2,
    "noise": 2,
    "single_point": 2,
    "arm_file": 3,
    "chain": 3,
    "comprehensive": 3,
    "continuation": 3,
    "limits": 3,
    "workshop": 3,
    "measurement_columns": 3,
    "measurements": 4,
    "swivel": 3,
    "three_revolutes": 3,
    "zonotope": 3,
    "even_spacing": 4,
    "pose_conditions": 4,
    "read_urdf": 4,
    "poses": 4,
    "reaching": 4,
    "urdf": 4,
    "arm_text": 4,
    "arm": 5,
    "circle": 5,
    "reach": 5,
    "reaching_tip": 5,
    "solution_search": 5,
    "corrected_urdf": 6,
    "room": 6,
    "state": 6,
    "isolated": 6,
    "postures_at_point": 6,
    "self_motion": 6,
    "configurations": 7,
    "reaching_postures": 7,
    "effects": 7,
    "observations": 7,
    "sino6_paper": 8,
    "zero_offset_paper": 7,
    "postures": 7,
    "plans": 8,
    "effect_words": 8,
    "error_model": 8,
    "error_sources": 9,
    "parameter_draws": 9,
    "calibration": 9,
    "diagnosis": 11,
    "planning": 10,
    "virtual": 9,
    "exact_volume": 10,
    "monte_carlo": 10,
    "spread": 10,
    "calibration_findings": 10,
    "diagnosis_findings": 12,
    "perturbed": 10,
    "plan_tables": 11,
    "accuracy": 11,
    "pairing": 12,
    "table3_diagnosis": 12,
    "workspace": 12,
    "plots": 13,
    "summaries": 13,
    "diagnosis_tables": 14,
    "display": 14,
    "report": 15,
    "calibration_page": 16,
    "cards": 16,
    "diagnosis_page": 16,
    "hidden_causes": 16,
    "demo": 17,
    "cli": 18,
}
IMPORT_PINOCCHIO = {"arm", "poses", "display"}

ROOT = Path(aacmm_pin.__file__).parent
MODULES = sorted(".".join(p.relative_to(ROOT).with_suffix("").parts) for p in ROOT.rglob("*.py"))


def imports(source: str, module: str) -> list[str]:
    """Absolute dotted names of all that ``module`` (``dh``, ``sino6_paper.tables``) imports, wherever in its text."""
    package = ["aacmm_pin", *module.split(".")[:-1]]
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join(above + ([node.module] if node.module else []))
            names += [f"{origin}.{alias.name}" for alias in node.names]
    return names


def violations(source: str, module: str) -> list[str]:
    here = module.split(".")[0]
    if here == "__init__":
        return []
    if here not in FLOORS:
        return [f"{module} has no floor: give it one in FLOORS of tests/test_floors.py"]
    found = []
    for name in imports(source, module):
        package, _, inside = name.partition(".")
        there = inside.split(".")[0]
        if package != "aacmm_pin" or there == here:
            continue
        if there not in FLOORS:
            found.append(f"{module} imports {name}, which has no floor: import the module that defines it")
        elif FLOORS[there] >= FLOORS[here]:
            found.append(f"{module} (floor {FLOORS[here]}) imports {name} (floor {FLOORS[there]})")
    return found


def imports_pinocchio(source: str, module: str) -> bool:
    return any(name.split(".")[0] == "pinocchio" for name in imports(source, module))


def text(module: str) -> str:
    return ROOT.joinpath(*module.split(".")).with_suffix(".py").read_text(encoding="utf-8")


@pytest.mark.parametrize("module", MODULES)
def test_imports_only_from_lower_floors(module: str) -> None:
    assert violations(text(module), module) == []


def test_only_the_arm_imports_pinocchio() -> None:
    assert {module for module in MODULES if imports_pinocchio(text(module), module)} <= IMPORT_PINOCCHIO


@pytest.mark.parametrize(
    ("source", "module", "said"),
    [
        ("import aacmm_pin.arm.arm", "dh", "dh (floor 2) imports aacmm_pin.arm.arm (floor 5)"),
        ("from aacmm_pin.arm.arm import Arm", "arm_file", "(floor 5)"),
        ("from aacmm_pin import arm", "checks", "(floor 5)"),
        ("from aacmm_pin._support.units import MM", "errors", "(floor 0)"),  # same floor
        ("from .cli import main", "dh", "(floor 18)"),
        ("from . import cli", "dh", "(floor 18)"),
        ("from ..cli import main", "sino6_paper.tables", "(floor 18)"),
        ("def f():\n    from aacmm_pin.arm.arm import Arm", "dh", "(floor 5)"),
        ("if TYPE_CHECKING:\n    from aacmm_pin.arm.arm import Arm", "dh", "(floor 5)"),
        ("import aacmm_pin", "arm", "no floor"),
        ("from aacmm_pin import Arm", "cli", "no floor"),
        ("", "brand_new", "give it one"),
    ],
)
def test_a_violation_is_caught(source: str, module: str, said: str) -> None:
    (found,) = violations(source, module)
    assert said in found


@pytest.mark.parametrize(
    ("source", "module"),
    [
        ("from aacmm_pin.errors import AacmmError\nfrom .units import MM\nimport numpy.linalg", "dh"),
        ("from aacmm_pin.papers.sino6.tables import A\nfrom . import tables\nfrom ..arm import Arm", "sino6_paper.figures"),
        ("from aacmm_pin.cli import main", "__init__"),
    ],
)
def test_an_allowed_import_passes(source: str, module: str) -> None:
    assert violations(source, module) == []


@pytest.mark.parametrize("source", ["import pinocchio as pin", "from pinocchio.utils import rotate"])
def test_pinocchio_is_seen(source: str) -> None:
    assert imports_pinocchio(source, "dh")
