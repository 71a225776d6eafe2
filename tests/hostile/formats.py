"""The formats that are read, valid files of each, and files like these with mistakes in them."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from aacmm_pin.arm import Arm, arm_text
from aacmm_pin.arm.dh_to_urdf import urdf_text
from aacmm_pin.calibration import calibrate
from aacmm_pin.effects import ErrorModel, cause_of
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements, simulate_measurements
from aacmm_pin.planning import plan_measurements

NUMBERS = [
    *str.split("0 -0 -1 1e300 -1e300 1e-300 1e154 5e-324 1.7976931348623157e308 1e9999"),
    *str.split("nan inf -inf 1_000 1,5 0x10 ٣ --1 2147483648 9223372036854775808 true"),
    *("9" * 5000, "0." + "3" * 400, ""),
]
TEXTS = [
    *"\0\"'<&{[]}=,;#$\n\r\t\v\x1b\u202e",
    *str.split("\x1b[2J $x$ $\\frac =1+1 ../../x /dev/zero é\u0301 S2 A nan 1e3 true {} ]]>"),
    *str.split("--> &a;"),
    *("", "<!ENTITY a 'b'>", "'''", '"""'),
    *("n" * 300, "[" * 3000, "a." * 3000 + "a=1", "<a>" * 3000),
]


@dataclass(frozen=True)
class Format:
    """How a file of a format is called, some valid ones, and what is done with one."""

    name: str
    valid: Callable[[], list[bytes]]
    use: Callable[[Path], object]


@cache
def arms() -> list[bytes]:
    """The bundled arms."""
    folder = Path(__file__).parents[2] / "aacmm_pin" / "arm" / "bundled"
    return [path.read_bytes() for path in sorted(folder.glob("*.toml"))]


@cache
def extended_arms() -> list[bytes]:
    """A calibrated arm with causes and a covariance."""
    causes = (
        "encoder_eccentricity:3,amplitude_rad=1e-4 joint_compliance:2 "
        "zero_drift:1,time_constant_s=600 stylus_offset"
    )
    model = ErrorModel.load("sino6")
    calibrated = calibrate(
        model.arm, records("free"), [cause_of("encoder_eccentricity:3", model)], hold_out=False
    ).model
    stated = model.with_effects(*(cause_of(text, model) for text in causes.split()))
    return [toml_of(each) for each in (calibrated, stated)]


def toml_of(model: ErrorModel) -> bytes:
    """As it is saved."""
    return arm_text(model.file()).encode()


@cache
def arms_of_a_urdf() -> list[bytes]:
    """One that names a URDF by its whole path, with corrected placements, a cause and a
    covariance.
    """
    arm = Arm.from_urdf(
        Path(__file__).parents[2] / "urdf" / "sino6.urdf", "tip", translation_half_width=1e-4
    )
    cause = cause_of("joint_compliance:2", ErrorModel(arm))
    found = calibrate(arm, records("free"), [cause], encoder_noise=8e-6, hold_out=False).model
    return [found.text(path="/arm.toml").replace('file = "', 'file = "/', 1).encode()]


@cache
def records(plan: str) -> Measurements:
    """A few virtual records."""
    bar = 0.5 if plan == "ball-bar" else None
    rng = np.random.default_rng(1)
    return simulate_measurements(Arm.load("sino6"), plan, 24, rng=rng, seats=4, bar_length=bar)


@cache
def csvs() -> list[bytes]:
    """Records of each plan, in degrees and in radians."""
    tables = [
        records(plan).to_frame(unit)
        for plan, unit in (("free", "deg"), ("seats", "rad"), ("ball-bar", "deg"))
    ]
    return [table.to_csv(index=False).encode() for table in tables]


@cache
def plans() -> list[bytes]:
    """A plan of what to measure."""
    plan = plan_measurements(Arm.load("sino6"), None, 8, postures=30, rng=np.random.default_rng(1))
    return [plan.csv().encode()]


@cache
def urdfs() -> list[bytes]:
    """The bundled arms, which have their masses too."""
    return [urdf_text(Arm.load(name).file).encode() for name in ("sino6", "zero6")]


def use_arm(path: Path) -> None:
    """Read it, and place the tip."""
    placed(ErrorModel.load(str(path)))


def use_urdf(path: Path) -> None:
    """The same."""
    placed(ErrorModel(Arm.from_urdf(path, "tip")))


def placed(model: ErrorModel) -> None:
    """The tip at the middle of the limits, by the arm alone and with its causes, as numbers."""
    q = np.zeros((2, model.arm.nq))
    assert np.isfinite(model.arm.positions(q)).all()
    with suppress(AacmmError):  # a cause needs conditions
        assert np.isfinite(model.predict(q)).all()


def use_plan(path: Path) -> Measurements:
    """Read the records, write them, read them again."""
    read = Measurements.read(path, 6)
    again = path.with_name(f"again-{path.name}")  # other formats are tried beside at the same time
    read.save(again, force=True)
    np.testing.assert_allclose(Measurements.read(again, 6).q, read.q, rtol=1e-12, atol=1e-15)
    return read


def use_records(path: Path) -> None:
    """The same, and calibrate with them."""
    calibrate(Arm.load("sino6"), use_plan(path), "zero-offsets", hold_out=False)


FORMATS = [
    Format("arm.toml", arms, use_arm),
    Format("extended-arm.toml", extended_arms, use_arm),
    Format("arm-of-a-urdf.toml", arms_of_a_urdf, use_arm),
    Format("arm.urdf", urdfs, use_urdf),
    Format("records.csv", csvs, use_records),
    Format("plan.csv", plans, use_plan),
]


@st.composite
def mutated(draw: st.DrawFn, valid: list[bytes]) -> bytes:
    """A valid file with one to four mistakes."""
    content = draw(st.sampled_from(valid))
    for _ in range(draw(st.integers(1, 4))):
        content = draw(st.sampled_from(MISTAKES))(draw, content)
    return content


def _number(draw: st.DrawFn, content: bytes) -> bytes:
    plausible = st.floats(-10.0, 10.0).map(repr)
    some = st.one_of(
        st.sampled_from(NUMBERS),
        st.floats().map(repr),
        plausible,
        st.integers(-(10**6), 10**6).map(str),
    )
    return _replaced(draw, content, rb"-?[0-9][0-9.]*(?:e-?[0-9]+)?", draw(some))


def _word(draw: st.DrawFn, content: bytes) -> bytes:
    words = sorted({word.decode() for word in re.findall(rb"[A-Za-z_][\w-]*", content)}) or [""]
    some = st.one_of(st.sampled_from(TEXTS), st.text(max_size=8), st.sampled_from(words))
    return _replaced(draw, content, rb"[A-Za-z_][\w-]*", draw(some))


def _byte(draw: st.DrawFn, content: bytes) -> bytes:
    place = draw(st.integers(0, len(content)))
    return (
        content[:place] + draw(st.binary(max_size=3)) + content[place + draw(st.integers(0, 3)) :]
    )


def _end(draw: st.DrawFn, content: bytes) -> bytes:
    return content[: draw(st.integers(0, len(content)))]


def _line(draw: st.DrawFn, content: bytes) -> bytes:
    """A line or more left out, doubled, or put somewhere else."""
    lines = content.splitlines(keepends=True) or [b""]
    first, other = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines)))
    some = lines[first : first + draw(st.integers(1, 5))]
    if draw(st.booleans()):
        del lines[first : first + len(some)]
    if draw(st.booleans()):
        lines[other:other] = some
    return b"".join(lines)


def _replaced(draw: st.DrawFn, content: bytes, pattern: bytes, by: str) -> bytes:
    found = list(re.finditer(pattern, content))
    if not found:
        return content
    match = found[draw(st.integers(0, len(found) - 1))]
    return content[: match.start()] + by.encode("utf-8", "surrogatepass") + content[match.end() :]


MISTAKES = [_number, _number, _word, _byte, _end, _line]
