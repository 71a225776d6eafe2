"""Arm files (TOML): a DH table, or a URDF with corrections.

Files have mm and rad (degrees in keys ``…_deg``); properties of :class:`ArmFile` SI.
"""

from __future__ import annotations

import importlib.resources
import os
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
import tomli_w
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
    model_validator,
)

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.plausible import (
    MOST_COUPLINGS,
    MOST_JOINTS,
    MOST_ROWS,
    MOST_TURNS,
    SHIFT_HALF_WIDTH,
    SMALLEST_ARM,
    Acceleration,
    Angle,
    AngleHalfWidth,
    EncoderNoise,
    EncoderNoiseMm,
    LengthMm,
    Mass,
    Name,
    NonNegative,
    PlaceMm,
    StandardUncertainty,
    TemperatureC,
    Text,
    expected_words,
    like_degrees,
    without_nul,
)
from aacmm_pin._support.units import DEG, MM
from aacmm_pin.arm.couplings import Coupling, coupling_matrix
from aacmm_pin.arm.dh import KINDS, DHTable, table
from aacmm_pin.arm.example_robots import EXAMPLE_ROBOTS
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.errors import AacmmError, ArmFileError, UnknownNameError

COVERAGE_FACTOR = 2.0
"""A calibrated parameter counts as within ± U, U = k u (JCGM 100:2008, 6.2)."""

MOST_BYTES = 32_000_000
"""A file with a covariance of a thousand parameters has half of it."""
UR_FILES = (".yaml", ".yml", ".conf")

# TOML has arrays only; strict validation would refuse them where a tuple is meant.
_FROM_ARRAY = Field(strict=False)
Pair = Annotated[tuple[FiniteFloat, FiniteFloat], _FROM_ARRAY]
Vector3 = Annotated[tuple[FiniteFloat, FiniteFloat, FiniteFloat], _FROM_ARRAY]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _WithAngles(_Part):
    """A table whose keys ``…_rad`` may be ``…_deg``."""

    @model_validator(mode="before")
    @classmethod
    def _in_radians(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        in_radians = dict(data)
        for key in data:
            name = f"{key.removesuffix('_deg')}_rad"
            if not key.endswith("_deg") or name not in cls.model_fields:
                continue
            if name in data:
                raise ValueError(f"both {key} and {name} are stated; expected one of these keys")
            degrees = in_radians.pop(key)
            numbers = degrees if isinstance(degrees, list) else [degrees]
            if any(type(number) not in (int, float) for number in numbers):
                raise ValueError(
                    f"{key} is {reprlib.repr(degrees)}; expected numbers as in {name}, but in "
                    "degrees"
                )
            radians = [number * DEG for number in numbers]
            in_radians[name] = radians if isinstance(degrees, list) else radians[0]
        return in_radians


class Uncertainty(_WithAngles):
    """Half-widths of the values of one row."""

    a_mm: NonNegative
    d_mm: NonNegative
    alpha_rad: AngleHalfWidth
    theta_offset_rad: AngleHalfWidth


JOINT_KEYS = ("limits_rad", "encoder_noise_rad", "limits_mm", "encoder_noise_mm")


class DHRow(_WithAngles):
    """One DH row: a joint, or with ``fixed = true`` a rigid piece such as a stylus."""

    a_mm: LengthMm
    d_mm: PlaceMm
    alpha_rad: FiniteFloat
    theta_offset_rad: FiniteFloat
    kind: Literal["revolute", "prismatic"] = "revolute"
    fixed: bool = False
    limits_rad: Pair | None = None
    limits_mm: Pair | None = None
    uncertainty: Uncertainty | None = None
    encoder_noise_rad: EncoderNoise | None = None
    encoder_noise_mm: EncoderNoiseMm | None = None
    mass_kg: Mass | None = None
    com_mm: Annotated[tuple[PlaceMm, PlaceMm, PlaceMm], _FROM_ARRAY] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> DHRow:
        angles = [("alpha_rad", self.alpha_rad, 1), ("theta_offset_rad", self.theta_offset_rad, 1)]
        angles += [
            (f"limits_rad[{i}]", limit, MOST_TURNS)
            for i, limit in enumerate(self.limits_rad or (), start=1)
        ]
        for key, angle, most in angles:
            if reason := like_degrees(angle, most):
                raise ValueError(f"{key} {reason}, or a key that ends in _deg")
        if self.fixed and self.slides:
            raise ValueError('kind is "prismatic" and fixed is true; expected one of them')
        limits = f"limits_{self.unit}"
        allowed = () if self.fixed else (limits, f"encoder_noise_{self.unit}")
        for key in JOINT_KEYS:
            if key not in allowed and getattr(self, key) is not None:
                kind = "fixed" if self.fixed else self.kind
                raise ValueError(f"a {kind} row has {key}; expected a row without this key")
        if not self.fixed and self._limits is None:
            raise ValueError(f"{limits} is missing; expected [lower, upper] for each joint")
        if self._limits is not None and not self._limits[0] < self._limits[1]:
            raise ValueError(f"{limits} is {list(self._limits)}; expected the lower limit first")
        if self.com_mm is not None and self.mass_kg is None:
            raise ValueError("com_mm is stated without mass_kg; expected both")
        return self

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return self.kind == "prismatic"

    @property
    def unit(self) -> str:
        """Unit of its readings in the file."""
        return "mm" if self.slides else "rad"

    @property
    def _scale(self) -> float:
        return MM if self.slides else 1.0

    @property
    def _limits(self) -> Pair | None:
        return self.limits_mm if self.slides else self.limits_rad

    @property
    def limits(self) -> Pair | None:
        """Limits of the reading [rad; m for prismatic joints]; None for a fixed row."""
        if self._limits is None:
            return None
        lower, upper = self._limits
        return lower * self._scale, upper * self._scale

    @property
    def encoder_noise(self) -> float | None:
        """Standard uncertainty of a reading [rad; m for prismatic joints]; None if not stated."""
        noise = self.encoder_noise_mm if self.slides else self.encoder_noise_rad
        return None if noise is None else noise * self._scale

    def with_encoder_noise(self, noise: float) -> DHRow:
        """The row with this standard uncertainty of a reading [rad; m for prismatic joints]."""
        return self.model_copy(update={f"encoder_noise_{self.unit}": noise / self._scale})


class Stylus(_Part):
    """Direction of the stylus in the last frame."""

    axis: Vector3

    @model_validator(mode="after")
    def _has_length(self) -> Stylus:
        if not any(self.axis):
            raise ValueError("axis is [0, 0, 0]; expected a direction, not all zeros")
        return self


class EffectEntry(_Part):
    """A cause in the file, whose fields and parameters :mod:`aacmm_pin.effects` checks."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)

    cause: Name
    parameters: dict[str, FiniteFloat] = Field(default_factory=dict)
    uncertainty: dict[str, FiniteFloat] = Field(default_factory=dict)

    @property
    def structure(self) -> dict[str, Any]:
        """The fields of the cause."""
        structure = dict(self.model_extra or {})
        for key, value in structure.items():
            if isinstance(value, list):
                structure[key] = tuple(value)
        return structure


class DiscrepancyPart(_Part):
    """Smooth functions of a discrepancy, and their carrier; see
    :mod:`aacmm_pin.effects.smooth_discrepancy`.
    """

    acts_on: Name
    functions: list[dict[str, Any]] = Field(default_factory=list)


class DiscrepancyEntry(_Part):
    """Unexplained structure as smooth functions of recorded quantities."""

    depends_on: Name
    parts: Annotated[list[DiscrepancyPart], Field(min_length=1, max_length=1)]
    values_si: Annotated[tuple[FiniteFloat, ...], _FROM_ARRAY, Field(min_length=1)]
    standard_uncertainty_si: Annotated[tuple[StandardUncertainty, ...], _FROM_ARRAY] = ()


class Covariance(_Part):
    """Covariance of parameters from a calibration; replaces their half-widths.

    ``records`` are fingerprints of its records, separated by blanks: none counts twice.
    """

    parameters: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]
    standard_uncertainty_si: Annotated[tuple[StandardUncertainty, ...], _FROM_ARRAY]
    correlation: Annotated[tuple[Annotated[tuple[FiniteFloat, ...], _FROM_ARRAY], ...], _FROM_ARRAY]
    records: str = ""

    @model_validator(mode="after")
    def _consistent(self) -> Covariance:
        n = len(self.parameters)
        if len(set(self.parameters)) != n:
            raise ValueError("parameters contains a name twice; expected each name once")
        if len(self.standard_uncertainty_si) != n:
            raise ValueError(
                f"standard_uncertainty_si has {len(self.standard_uncertainty_si)} numbers; "
                f"expected {n}"
            )
        if [len(row) for row in self.correlation] != list(range(n)):
            raise ValueError(
                f"correlation: expected {n} rows of 0, 1, … {n - 1} numbers (the part below the "
                "diagonal), such as [[], [0.5], [0.1, -0.2]]"
            )
        matrix = self.matrix_of_correlation()
        if np.abs(matrix).max() > 1 + 1e-9 or np.linalg.eigvalsh(matrix).min() < -1e-6:
            raise ValueError("correlation has a negative eigenvalue; expected a correlation matrix")
        return self

    @staticmethod
    def of(names: Sequence[str], u: Array, correlation: Array, records: str) -> Covariance:
        """From all u (p,) and correlations (p, p)."""
        return Covariance(
            parameters=tuple(names),
            standard_uncertainty_si=tuple(u.tolist()),
            correlation=tuple(tuple(row[:i]) for i, row in enumerate(correlation.tolist())),
            records=records,
        )

    def restricted(self, names: Iterable[str]) -> Covariance | None:
        """The part for parameters in ``names``, or None."""
        wanted = set(names)
        kept = [i for i, name in enumerate(self.parameters) if name in wanted]
        if not kept:
            return None
        kept_names = [self.parameters[i] for i in kept]
        u = np.array(self.standard_uncertainty_si)[kept]
        correlation = self.matrix_of_correlation()[np.ix_(kept, kept)]
        return Covariance.of(kept_names, u, correlation, self.records)

    @property
    def u(self) -> dict[str, float]:
        """Standard uncertainties by the names of the parameters [their SI units]."""
        return dict(zip(self.parameters, self.standard_uncertainty_si, strict=True))

    def matrix_of_correlation(self) -> Array:
        """The full matrix (p, p)."""
        matrix = np.eye(len(self.parameters))
        for i, row in enumerate(self.correlation):
            matrix[i, :i] = matrix[:i, i] = row
        return matrix

    def matrix(self) -> Array:
        """Covariance of the parameters (p, p) [their SI units]."""
        u = np.array(self.standard_uncertainty_si)
        return self.matrix_of_correlation() * np.outer(u, u)


class AnyArmFile(_Part):
    """The content of every arm file."""

    schema_: Literal["aacmm-pin/arm/1"] = Field(alias="schema")
    name: Name
    source: Text = ""
    reference_temperature_c: TemperatureC = 20.0
    gravity_m_s2: Annotated[tuple[Acceleration, Acceleration, Acceleration], _FROM_ARRAY] = (
        0.0,
        0.0,
        -9.81,
    )
    stylus: Stylus | None = None
    unexplained: Text = ""
    tip_on_target: bool = False
    couplings: Annotated[list[Coupling], Field(max_length=MOST_COUPLINGS)] = Field(
        default_factory=list
    )
    effects: list[EffectEntry] = Field(default_factory=list)
    discrepancy: list[DiscrepancyEntry] = Field(default_factory=list)
    covariance: Covariance | None = None


Kind = TypeVar("Kind", bound=BaseModel)


class Urdf(_WithAngles):
    """The URDF, the frame at the tip, and half-widths of placements.

    A changed URDF is refused by its SHA-256. The path is relative to the folder of the arm file (in
    memory, absolute): both can move together.
    """

    file: Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(without_nul)]
    frame: Name
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    translation_half_width_mm: Annotated[
        FiniteFloat, Field(ge=0.0, le=SHIFT_HALF_WIDTH.most / MM)
    ] = 0.0
    rotation_half_width_rad: AngleHalfWidth = 0.0


class UrdfJoint(_WithAngles):
    """A joint of the URDF: the twist of its placement, in its own axes, and its encoder."""

    name: Name
    shift_mm: Annotated[tuple[LengthMm, LengthMm, LengthMm], _FROM_ARRAY] = (0.0, 0.0, 0.0)
    turn_rad: Annotated[tuple[Angle, Angle, Angle], _FROM_ARRAY] = (0.0, 0.0, 0.0)
    encoder_noise_rad: EncoderNoise | None = None
    unit: ClassVar[str] = "rad"

    @property
    def encoder_noise(self) -> float | None:
        """Standard uncertainty of a reading [rad; m for prismatic joints]; None if not stated."""
        return self.encoder_noise_rad

    def with_encoder_noise(self, noise: float) -> UrdfJoint:
        """The joint with this standard uncertainty of a reading [rad; m for prismatic joints]."""
        return self.model_copy(update={"encoder_noise_rad": noise})


class UrdfArmFile(AnyArmFile):
    """A validated arm file with a URDF."""

    urdf: Urdf
    joints: Annotated[list[UrdfJoint], Field(max_length=MOST_JOINTS)] = Field(default_factory=list)

    @model_validator(mode="after")
    def _of_one_urdf(self) -> UrdfArmFile:
        if self.urdf.sha256 is None and (self.joints or self.covariance is not None):
            raise ValueError(
                "urdf.sha256 is missing; expected the SHA-256 of the URDF to which joints and "
                "covariance belong"
            )
        _check_noise(enumerate(self.joints, start=1))
        return self

    @property
    def corrections(self) -> Array:
        """Twists of the placements, v then ω (nq, 6) [m, rad]."""
        twists = np.array([joint.shift_mm + joint.turn_rad for joint in self.joints])
        twists = twists.reshape(-1, 6)
        twists[:, :3] *= MM
        return twists

    @property
    def encoder_noise(self) -> Array | None:
        """See :attr:`ArmFile.encoder_noise`."""
        return _noise(self.joints)


class ArmFile(AnyArmFile):
    """A validated arm file with a DH table."""

    convention: Literal["standard-dh", "modified-dh"]
    joints: Annotated[list[DHRow], Field(min_length=1, max_length=MOST_ROWS)]

    @model_validator(mode="after")
    def _has_a_joint(self) -> ArmFile:
        if all(row.fixed for row in self.joints):
            raise ValueError("all rows are fixed; expected at least one joint")
        if len(self.moving_rows) > MOST_JOINTS:
            raise ValueError(
                f"{len(self.moving_rows)} rows have a joint; expected at most {MOST_JOINTS}"
            )
        _check_noise(zip(self.moving_numbers, self.moving_rows, strict=True))
        coupling_matrix(self.couplings, self.moving_numbers)
        return self

    @model_validator(mode="after")
    def _has_a_plausible_size(self) -> ArmFile:
        if reason := self.dh.chain.beyond_reach():
            lengths = {
                f"joints[{number}].{key}": getattr(row, key)
                for number, row in enumerate(self.joints, start=1)
                for key in ("a_mm", "d_mm")
            }
            longest = max(lengths, key=lambda place: abs(lengths[place]))
            raise ValueError(f"{longest} is {lengths[longest]:g} mm, so that {reason}")
        if self.size * MM < SMALLEST_ARM:
            raise ValueError(
                f"the sum of all a_mm and d_mm is {self.size:g} mm; expected at least "
                f"{SMALLEST_ARM / MM:g} mm"
            )
        return self

    @property
    def size(self) -> float:
        """Sum of all lengths a and d [mm]."""
        return sum(abs(row.a_mm) + abs(row.d_mm) for row in self.joints)

    @property
    def dh(self) -> DHTable:
        """The DH table in SI."""
        rows = [
            [row.a_mm * MM, row.d_mm * MM, row.alpha_rad, row.theta_offset_rad]
            for row in self.joints
        ]
        moving = [not row.fixed for row in self.joints]
        slides = [row.slides for row in self.joints]
        return table(np.array(rows), self.convention, moving, slides)

    @property
    def moving_numbers(self) -> list[int]:
        """Numbers of the rows with a joint, from 1."""
        numbered = enumerate(self.joints, start=1)
        return [number for number, row in numbered if not row.fixed]

    @property
    def moving_rows(self) -> list[DHRow]:
        """The rows with a joint, in order."""
        return [row for row in self.joints if not row.fixed]

    @property
    def limits(self) -> Array:
        """Joint limits, (nq, 2) [rad; m for prismatic joints]."""
        return np.array([row.limits for row in self.moving_rows], dtype=np.float64)

    @property
    def encoder_noise(self) -> Array | None:
        """Standard uncertainty of one reading, (nq,) [rad; m for prismatic joints]; None if not
        stated.
        """
        return _noise(self.moving_rows)

    def dh_parameters(self) -> tuple[Parameter, ...]:
        """The four values of every row, in the order of :attr:`DHTable.chain`; u = 0 if not
        stated.
        """
        parameters = []
        for number, row in enumerate(self.joints, start=1):
            for kind in KINDS:
                unit, scale = ("m", MM) if kind in ("a", "d") else ("rad", 1.0)
                field = f"{kind}_mm" if unit == "m" else f"{kind}_rad"
                half = None if row.uncertainty is None else getattr(row.uncertainty, field) * scale
                name = f"{kind}{number}"
                value = getattr(row, field) * scale
                parameters.append(Parameter.bounded(name, kind, number, unit, value, half))
        return calibrated(parameters, self.covariance)


def _noise(joints: Iterable[DHRow | UrdfJoint]) -> Array | None:
    noise = [joint.encoder_noise for joint in joints]
    return np.array(noise, dtype=np.float64) if noise and None not in noise else None


def _check_noise(numbered: Iterable[tuple[int, DHRow | UrdfJoint]]) -> None:
    """Refuse encoder noise of only some joints."""
    keys = {f"joints[{number}].encoder_noise_{joint.unit}": joint for number, joint in numbered}
    missing = [key for key, joint in keys.items() if joint.encoder_noise is None]
    if 0 < len(missing) < len(keys):
        raise ValueError(f"{missing[0]} is missing; expected a value for all joints or for none")


def calibrated(
    parameters: Iterable[Parameter], covariance: Covariance | None
) -> tuple[Parameter, ...]:
    """The parameters; those in the ``covariance`` with its u and the bound ± k u."""
    if covariance is None:
        return tuple(parameters)
    by_name = {parameter.name: parameter for parameter in parameters}
    for name, u in covariance.u.items():
        if name in by_name:
            by_name[name] = replace(by_name[name], u=u, half_width=COVERAGE_FACTOR * u)
    return tuple(by_name.values())


def bundled_arms() -> list[str]:
    """Names of the bundled arms."""
    folder = importlib.resources.files("aacmm_pin.arm") / "bundled"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_arm_file(name_or_path: str | Path) -> ArmFile:
    """Read an arm file with a DH table; a URDF is an ArmFileError."""
    file = read_arm_file(name_or_path)
    if isinstance(file, UrdfArmFile):
        raise ArmFileError(
            str(name_or_path), "urdf", "this arm has a URDF; expected an arm with a DH table"
        )
    return file


def read_arm_file(name_or_path: str | Path) -> ArmFile | UrdfArmFile:
    """Read a bundled arm by name (``sino6``) or an arm file by path."""
    name = str(name_or_path)
    if name in bundled_arms():
        resource = importlib.resources.files("aacmm_pin.arm") / "bundled" / f"{name}.toml"
        return parse_arm_file(resource.read_bytes(), f"{name}.toml")
    path = Path(name_or_path)
    if path.suffix != ".toml" and not os.path.exists(path):
        names = [*bundled_arms(), *EXAMPLE_ROBOTS]
        raise UnknownNameError("arm", name, names, "or state the path of an arm file, *.toml")
    content = content_of(
        path, MOST_BYTES, "an arm file (*.toml)", lambda message: ArmFileError(name, "", message)
    )
    return parse_arm_file(content, name)


def toml_of(content: bytes, refused: Callable[[str], AacmmError]) -> dict[str, Any]:
    """The table of a TOML file."""
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise refused(f"byte {error.start} is not UTF-8; expected a TOML file in UTF-8") from None
    except (ValueError, RecursionError) as error:  # also of tables in thousands of tables
        raise refused(f"{error}; expected TOML, with a decimal point in numbers") from None


def parse_arm_file(content: bytes, path: str) -> ArmFile | UrdfArmFile:
    """Validate the content of an arm file at ``path``, where relative paths of a URDF start."""
    refuse_ur_file(path)
    suffix = Path(path).suffix.lower()
    if suffix == ".csv":
        raise ArmFileError(
            path, "", "this is a table (CSV); expected an arm file (TOML); state ARM before DATA"
        )
    if suffix == ".urdf":
        raise ArmFileError(
            path,
            "",
            f"this is a URDF; expected an arm file (TOML); use --urdf {path} --frame NAME (in "
            "Python Arm.from_urdf)",
        )
    data = toml_of(content, lambda message: ArmFileError(path, "", message))
    if "urdf" not in data:
        return validated(ArmFile, data, path)
    file = validated(UrdfArmFile, data, path)
    absolute = os.path.abspath(Path(os.path.realpath(path)).parent / file.urdf.file)
    return file.model_copy(update={"urdf": file.urdf.model_copy(update={"file": absolute})})


def refuse_ur_file(path: str) -> None:
    """Raises ArmFileError for a kinematics file of Universal Robots."""
    if path.lower().endswith(UR_FILES):
        raise ArmFileError(
            path,
            "",
            "the name is that of a kinematics file of Universal Robots; expected an arm file "
            f"(*.toml) or a URDF; to write its URDF, run aacmm-pin urdf {path} -o robot.urdf",
        )


def validated(kind: type[Kind], data: dict[str, Any], path: str) -> Kind:
    """The arm file of ``data``."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        (key, message), *others = [_problem(item, kind) for item in error.errors()]
        for problem in others:
            message += f"\n{ArmFileError(path, *problem)}"
        raise ArmFileError(path, key, message) from None


def _problem(item: Any, kind: type[BaseModel]) -> tuple[str, str]:
    parts = [f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in item["loc"]]
    key = "".join(parts).removeprefix(".")
    match item["type"]:
        case "extra_forbidden":
            kinds = {
                "joints": DHRow if kind is ArmFile else UrdfJoint,
                "urdf": Urdf,
                "uncertainty": Uncertainty,
                "stylus": Stylus,
                "couplings": Coupling,
                "discrepancy": DiscrepancyEntry,
                "parts": DiscrepancyPart,
                "covariance": Covariance,
            }
            parents = [part for part in item["loc"][:-1] if isinstance(part, str)]
            fields = (kinds[parents[-1]] if parents else kind).model_fields
            keys = sorted(field.alias or name for name, field in fields.items())
            return key, f"unknown key; expected one of {', '.join(keys)}"
        case "missing":
            return key, "missing key; expected a value"
        case "value_error":
            return key, str(item["ctx"]["error"])
    expected = re.sub("[0-9]{16,}", lambda digits: f"{float(digits[0]):g}", expected_words(item))
    return key, f"{reprlib.repr(item['input'])}; expected {expected}"


def arm_text(arm: ArmFile | UrdfArmFile, comment: str = "", path: str | Path | None = None) -> str:
    """TOML of ``arm`` with exact numbers.

    Args:
        comment: lines at the beginning.
        path: for the relative path of a URDF; None is beside the URDF.
    """
    content = {"schema": arm.schema_} | arm.model_dump(
        by_alias=True, exclude_none=True, exclude_defaults=True
    )
    for last in ("couplings", "effects", "discrepancy", "covariance"):
        if last in content:
            content[last] = content.pop(last)
    if isinstance(arm, UrdfArmFile):
        folder = Path(arm.urdf.file if path is None else os.path.realpath(path)).parent
        content["urdf"]["file"] = Path(os.path.relpath(arm.urdf.file, folder)).as_posix()
    lines = [
        f"# {''.join(c if c.isprintable() else ' ' for c in line)}".rstrip()
        for line in comment.splitlines()
    ]
    return "\n".join([*lines, *([""] if lines else []), tomli_w.dumps(content)])
