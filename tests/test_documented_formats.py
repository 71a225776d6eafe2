"""The keys of files and JSON that the documentation explains are those that are read and
written.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import pandas as pd
import pytest
from pydantic import BaseModel

import aacmm_pin
from aacmm_pin import effects
from aacmm_pin.arm import file as arm_file
from aacmm_pin.effects import CAUSES, Smooth
from aacmm_pin.measurements import MEASUREMENT_FILE, PROBED_POINT_COLUMNS, REFERENCE
from aacmm_pin.measurements.csv_columns import EULER_ANGLES, FEATURE, numbered_forms, single_names
from tests.cli import shell

SITE = Path(__file__).parents[1] / "notebooks" / "site"
SECTIONS = {
    page: dict(
        re.findall(
            r"^#+ (.+?)\n(.*?)(?=^#+ |\Z)",
            (SITE / f"{page}.md").read_text(encoding="utf-8"),
            re.MULTILINE | re.DOTALL,
        )
    )
    for page in ("arm_file", "measurement_file", "outputs")
}
KEYS_OF_AN_ARM = tuple(
    f"Keys of {part}"
    for part in ("the arm", "a joint", "a coupling", "a cause", "the covariance", "a discrepancy")
)
NAMED = ("inner", "parameters", "acts_on", "working_sectors", "alone_mm", "causes")
"""Objects whose keys are names or numbers that vary."""
LISTS = ("joints", "couplings", "effects", "discrepancy", "parts")
"""Parts of an arm file that it may have several of."""
NOT_OF_A_COMMAND = ("aacmm-pin/arm/1",)


def documented(page: str, *sections: str) -> dict[str, str]:
    """Keys in the first columns of the tables of sections, and what is said of each."""
    text = "".join(SECTIONS[page][section] for section in sections)
    rows = re.findall(r"^\| (`.+?) \| (.+) \|$", text, re.MULTILINE)
    return {key: words for keys, words in rows for key in re.findall("`(.+?)`", keys)}


def keys(value: Any, at: str = "") -> Iterator[str]:
    """Paths of all that is in a JSON value; empty lists and null are as they stand."""
    if isinstance(value, dict):
        for key, inner in value.items():
            name = "*" if at.rpartition(".")[2] in NAMED else key
            yield from keys(inner, f"{at}.{name}" if at else name)
    elif isinstance(value, list) and value:
        for inner in value:
            yield from keys(inner, f"{at}[]")
    else:
        yield at


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[str, set[str]]:
    """Keys that commands wrote, by schema; each of several small outputs adds some."""
    folder = tmp_path_factory.mktemp("json")
    data, external, hidden, poses = (
        str(folder / f"{name}.csv") for name in ("data", "external", "hidden", "poses")
    )
    simulate = "simulate sino6 --encoder-noise 8e-6 --records 60 -o"
    shell.done(
        f"{simulate} {data} --scheme free --cause "
        "joint_periodic_error:joint=3,order=7,amplitude_rad=5e-4"
    )
    shell.done(f"{simulate} {poses} --scheme seats --orientation-noise 50urad")
    shell.done(
        f"{simulate} {hidden} --scheme seats --cause base_compliance:compliance_rad_per_nm=3e-5"
    )
    table = pd.read_csv(data, dtype=str)
    table.loc[8, "x_mm"] = "999.0"
    table.to_csv(external, index=False)
    touches = str(folder / "touches.csv")
    table.assign(test="single-point", position=[str(k % 3) for k in range(60)]).to_csv(
        touches, index=False
    )

    noise = "--encoder-noise 8e-6 --u-reference-mm 0.012"
    found: dict[str, set[str]] = {}
    for command in (
        "accuracy sino6 --point 400 0 300 --samples 12",
        "accuracy sino6 --point 400 0 300 --samples 12 --method ellipsoid",
        "accuracy sino6 --point 400 0 300 --to 400 300 300 --samples 6",
        "map sino6 --cells 2 2 --axis 0 0 -1",
        "map sino6 --cells 3 3",
        f"check sino6 {external}",
        f"calibrate sino6 {data} {noise}",
        f"calibrate sino6 {external} --reference-frame external {noise}",
        f"calibrate sino6 {poses}",
        f"diagnose sino6 {poses} --no-cross-validation {noise}",
        f"diagnose sino6 {external} {noise}",
        f"diagnose sino6 {hidden} --no-cross-validation {noise}",
        f"diagnose-files sino6 {external} {noise}",
        f"plan distinguish sino6 --causes encoder_eccentricity:2 joint_compliance:2 "
        f"--existing {data} --records 4 --postures 30",
        "plan distinguish sino6 --records 4 --postures 30",
        f"accept {touches} --mpe SPAT.Max=0.1",
        "plan calibration sino6 --records 12 --postures 30",
    ):
        content = shell.found(command)
        found.setdefault(content["schema"], set()).update(keys(content))
    return found


def test_every_schema_has_a_section():
    source = "".join(
        path.read_text(encoding="utf-8") for path in Path(aacmm_pin.__file__).parent.rglob("*.py")
    )
    schemas = set(re.findall(r'"(aacmm-pin/[\w-]+/\d+)"', source)) - set(NOT_OF_A_COMMAND)
    assert {f"`{schema}`" for schema in schemas} <= set(SECTIONS["outputs"]), (
        "explain its keys in notebooks/site/outputs.md"
    )


SCHEMAS = "accuracy map check calibration diagnosis diagnoses plan calibration-plan acceptance"


@pytest.mark.long
@pytest.mark.parametrize("schema", SCHEMAS.split())
def test_json_keys_are_those_that_are_written(schema, written):
    name = f"aacmm-pin/{schema}/1"
    explained, came = documented("outputs", f"`{name}`"), written[name]
    unexplained = {key for key in came if not known(key, explained)}
    fields = {
        f"findings[].{field}" for cause in CAUSES.values() for field in effects.fields_of(cause)
    }
    assert unexplained - (fields if schema == "diagnosis" else set()) == set()
    never = {
        key
        for key, words in explained.items()
        if not arrived(key, came) and "only" not in words and "null" not in words
    }
    assert never == set(), "explained, but never written"


def known(key: str, explained: dict[str, str]) -> bool:
    """Whether a key is explained, or is an empty list or null in place of what is."""
    return key in explained or any(other.startswith((f"{key}.", f"{key}[")) for other in explained)


def arrived(key: str, came: set[str]) -> bool:
    """Whether a key came, or an empty list or null in its place."""
    return key in came or any(re.match(re.escape(other) + r"[.\[]", key) for other in came)


def fields_of(model: type[BaseModel], at: str = "") -> Iterator[str]:
    joint = arm_file.DHRow if model is arm_file.ArmFile else arm_file.UrdfJoint
    parts = {
        "joints": joint,
        "urdf": arm_file.Urdf,
        "uncertainty": arm_file.Uncertainty,
        "stylus": arm_file.Stylus,
        "couplings": arm_file.Coupling,
    }
    parts |= {"effects": arm_file.EffectEntry, "covariance": arm_file.Covariance}
    parts |= {"discrepancy": arm_file.DiscrepancyEntry, "parts": arm_file.DiscrepancyPart}
    for name, field in model.model_fields.items():
        key = f"{at}{field.alias or name}"
        if model is arm_file.EffectEntry and name in ("parameters", "uncertainty"):
            yield f"{key}.*"
        elif name in parts:
            yield from fields_of(parts[name], f"{key}[]." if name in LISTS else f"{key}.")
        elif model is arm_file.DiscrepancyPart and name == "functions":
            yield from (f"{key}[].{field}" for kind in get_args(Smooth) for field in names_of(kind))
        else:
            yield key


def names_of(functions: type) -> list[str]:
    return [each.name for each in fields(functions)]


def test_keys_of_the_arm_file():
    of_causes = {f"effects[].{name}" for name in ("joint", "between_s", "sessions", "until_s")}
    assert set(documented("arm_file", *KEYS_OF_AN_ARM)) - of_causes == set(
        fields_of(arm_file.ArmFile)
    )
    both = set(fields_of(arm_file.ArmFile)) & set(fields_of(arm_file.UrdfArmFile))
    both -= {key for key in both if key.startswith("joints")}
    assert (
        set(documented("arm_file", "Keys of a URDF")) == set(fields_of(arm_file.UrdfArmFile)) - both
    )


def test_columns_of_what_commands_write(tmp_path):
    data, *tables = (
        str(tmp_path / f"{name}.csv")
        for name in ("data", "circle", "accuracy", "residuals", "corrected", "to")
    )
    point = "--point 33.6 -671.9 182.9 --samples 6 -o"
    shell.done(
        f"simulate sino6 --scheme seats --records 40 --seats 5 --orientation-noise 5e-5 -o {data}"
    )
    shell.done(f"configurations sino6 {point} {tables[0]}")
    shell.done(f"accuracy sino6 {point} {tables[1]}")
    shell.done(f"calibrate sino6 {data} --no-cross-validation --residuals {tables[2]}")
    shell.done(f"correct sino6 {data} -o {tables[3]}")
    shell.done(f"correct sino6 {data} --nominal sino6 --commands -o {tables[4]}")
    came = [
        name
        for path in tables
        for name in pd.read_csv(path, nrows=1)
        if not re.fullmatch(r"(theta|command)[2-6]_deg", name)
    ]
    of_records = {*single_names(MEASUREMENT_FILE), *(f"approach{j}" for j in range(1, 7))}
    sections = (f"CSV: {what}" for what in ("postures", "residuals", "corrected readings"))
    explained = {key.removesuffix(" …") for key in documented("outputs", *sections)}
    assert explained == set(came) - (of_records - {"x_mm", "y_mm", "z_mm"})


def test_columns_of_the_acceptance_file():
    names = {key.removesuffix(" …") for key in documented("measurement_file", "Acceptance columns")}
    planned = {"articulation", "planned_x_mm", "planned_theta1_deg"}
    assert names - planned == {*single_names(PROBED_POINT_COLUMNS), *REFERENCE, "theta1_deg"}


def test_columns_of_the_measurement_file():
    tables = ("Common columns", "Optional columns")
    names = {key.removesuffix(" …") for key in documented("measurement_file", *tables)}
    numbered = {form.replace("#", "1") for form in numbered_forms(MEASUREMENT_FILE)}
    orders = {name for form in EULER_ANGLES for name in form if "zyx" not in name}
    known = {*single_names(MEASUREMENT_FILE), *numbered, FEATURE} - orders
    assert names | {"theta1_rad", "temperature1_c"} == known
