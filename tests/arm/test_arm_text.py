"""Arm files as text come back as they were."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from aacmm_pin.arm.file import ArmFile, bundled_arms, load_arm_file, parse_arm_file
from aacmm_pin.arm.text import arm_text


def read(text: str) -> ArmFile:
    return parse_arm_file(text.encode("utf-8"), "again.toml")


@pytest.mark.parametrize("name", bundled_arms())
def test_bundled_arm_comes_back(name: str) -> None:
    arm = load_arm_file(name)
    assert read(arm_text(arm)) == arm
    assert arm_text(read(arm_text(arm))) == arm_text(arm)


def test_variants_come_back(arm_file: ArmFile) -> None:
    assert read(arm_text(arm_file)) == arm_file


def test_every_bit_comes_back(rng: np.random.Generator) -> None:
    arm = load_arm_file("sino6")
    odd = [5e-324, -0.0, 0.1 + 0.2, 1e300, np.nextafter(1.0, 2.0), *rng.normal(size=30)]
    for value in map(float, odd):
        rows = [row.model_copy(update={"a_mm": value, "com_mm": (value, -value, 1.0)}) for row in arm.joints]
        back = read(arm_text(arm.model_copy(update={"joints": rows})))
        assert {row.a_mm.hex() for row in back.joints} == {value.hex()}
        assert back.joints == rows


def test_optional_parts_come_back() -> None:
    arm = load_arm_file("sino6")
    rows = [row.model_copy(update={"encoder_noise_rad": 1e-5}) for row in arm.joints]
    full = arm.model_copy(update={"joints": rows, "reference_temperature_c": 21.5, "gravity_m_s2": (0.0, -9.81, 0.0)})
    assert read(arm_text(full)) == full
    bare = load_arm_file("zero6").model_copy(update={"source": "", "stylus": None})
    assert read(arm_text(bare)) == bare
    assert "stylus" not in tomllib.loads(arm_text(bare))


@pytest.mark.parametrize("text", ['Ä "quoted" \\ #', "two\nlines", "tab\t", "\x07", "'''", '"""'])
def test_names_come_back(text: str) -> None:
    arm = load_arm_file("zero6").model_copy(update={"name": text, "source": text})
    assert read(arm_text(arm)) == arm


@pytest.mark.parametrize(
    "comment", ["one line", "two\nlines", "", "\n\n", 'schema = "x"', "a\x00b\x07c\rd", "tab\tand \u2028 Ä"]
)
def test_comments_change_nothing(comment: str) -> None:
    arm = load_arm_file("zero6")
    text = arm_text(arm, comment)
    assert read(text) == arm
    before = text[: text.index("schema = ")] if not comment.startswith("schema") else text.splitlines()[0]
    assert all(line.startswith("#") for line in before.splitlines() if line)


def test_schema_stands_first() -> None:
    assert arm_text(load_arm_file("sino6")).startswith('schema = "aacmm-pin/arm/1"\nname = "SINO6"\n')
