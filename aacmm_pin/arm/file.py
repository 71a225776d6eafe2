"""Arm files (TOML): the DH table of an arm with its uncertainties, limits and masses.

The file speaks millimetres and radians; the properties of :class:`ArmFile` speak SI.
"""

from __future__ import annotations

import importlib.resources
import math
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import MM
from aacmm_pin.arm.dh import KINDS, DHTable, table
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.errors import ArmFileError, UnknownNameError

MOST_TURNS = 5
"""A limit beyond so many turns is taken for degrees."""

COVERAGE_FACTOR = 2.0
"""A calibrated parameter counts as within ± U, U = k u with this k (JCGM 100:2008, 6.2)."""

NonNegative = Annotated[FiniteFloat, Field(ge=0.0)]
Vector3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _lists_are_tuples(cls, data: Any) -> Any:
        # TOML has arrays only; strict validation would refuse them where a tuple is meant.
        if isinstance(data, dict):
            return {k: tuple(v) if isinstance(v, list) and k not in ("joints", "effects") else v for k, v in data.items()}
        return data


class Uncertainty(_Part):
    """Half-widths of the calibration of one row: each value lies within ± the half-width."""

    a_mm: NonNegative
    d_mm: NonNegative
    alpha_rad: NonNegative
    theta_offset_rad: NonNegative


class Row(_Part):
    """One DH row: a joint, or with ``fixed = true`` a rigid piece such as a stylus."""

    a_mm: FiniteFloat
    d_mm: FiniteFloat
    alpha_rad: FiniteFloat
    theta_offset_rad: FiniteFloat
    fixed: bool = False
    limits_rad: tuple[FiniteFloat, FiniteFloat] | None = None
    uncertainty: Uncertainty | None = None
    encoder_noise_rad: NonNegative | None = None
    mass_kg: NonNegative | None = None
    com_mm: Vector3 | None = None

    @model_validator(mode="after")
    def _in_radians(self) -> Row:
        named = {"alpha_rad": self.alpha_rad, "theta_offset_rad": self.theta_offset_rad}
        named |= {f"limits_rad[{i + 1}]": limit for i, limit in enumerate(self.limits_rad or ())}
        for key, angle in named.items():
            most = MOST_TURNS if key.startswith("limits") else 1
            if abs(angle) > most * 2 * math.pi + 1e-9:
                raise ValueError(
                    f"{key} is {angle:g} rad, more than {most} turn(s): expected radians, these look like degrees"
                )
        return self

    @model_validator(mode="after")
    def _consistent(self) -> Row:
        if self.fixed and (self.limits_rad is not None or self.encoder_noise_rad is not None):
            raise ValueError("a fixed row has no joint: expected no limits_rad and no encoder_noise_rad")
        if not self.fixed and self.limits_rad is None:
            raise ValueError("limits_rad is missing, expected [lower, upper] for a joint")
        if self.limits_rad is not None and not self.limits_rad[0] < self.limits_rad[1]:
            raise ValueError(f"limits_rad is {list(self.limits_rad)}, expected the lower limit first")
        if self.com_mm is not None and self.mass_kg is None:
            raise ValueError("com_mm without mass_kg, expected both")
        return self


class Stylus(_Part):
    """Direction of the stylus in the last frame."""

    axis: Vector3

    @model_validator(mode="after")
    def _has_length(self) -> Stylus:
        if not any(self.axis):
            raise ValueError("axis is [0, 0, 0], expected a direction")
        return self


class EffectEntry(_Part):
    """A cause of error in the file: its name, which one it is (``joint``, ``order``, …), its parameters and their u.

    Which fields and parameters a cause has is known to :mod:`aacmm_pin.effects`, which is above this module.
    """

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)

    cause: Annotated[str, Field(min_length=1)]
    parameters: dict[str, FiniteFloat] = Field(default_factory=dict)
    uncertainty: dict[str, FiniteFloat] = Field(default_factory=dict)

    @property
    def structure(self) -> dict[str, Any]:
        """Everything but the cause, its parameters and their uncertainty."""
        return dict(self.model_extra or {})


class Covariance(_Part):
    """What a calibration knows of parameters together; it overrides the half-widths of the parameters that it names."""

    parameters: Annotated[tuple[str, ...], Field(min_length=1)]
    standard_uncertainty_si: tuple[NonNegative, ...]
    correlation: tuple[tuple[FiniteFloat, ...], ...]

    @model_validator(mode="before")
    @classmethod
    def _rows_are_tuples(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("correlation"), list | tuple):
            return data | {"correlation": tuple(tuple(r) if isinstance(r, list) else r for r in data["correlation"])}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Covariance:
        n = len(self.parameters)
        if len(set(self.parameters)) != n:
            raise ValueError("parameters names one of them twice")
        if len(self.standard_uncertainty_si) != n:
            raise ValueError(f"standard_uncertainty_si has {len(self.standard_uncertainty_si)} numbers, expected {n}")
        if [len(row) for row in self.correlation] != list(range(n)):
            raise ValueError(f"correlation: expected {n} rows of 0, 1, … {n - 1} numbers, the part below the diagonal")
        matrix = self.matrix_of_correlation()
        if np.abs(matrix).max() > 1 + 1e-9 or np.linalg.eigvalsh(matrix).min() < -1e-6:
            raise ValueError("correlation is not a correlation matrix: it has a negative eigenvalue")
        return self

    def restricted(self, names: Iterable[str]) -> Covariance | None:
        """The part about those of the parameters that are among ``names``; None where there is none."""
        among = set(names)
        keep = [i for i, name in enumerate(self.parameters) if name in among]
        if not keep:
            return None
        matrix = self.matrix_of_correlation()[np.ix_(keep, keep)]
        return Covariance(
            parameters=tuple(self.parameters[i] for i in keep),
            standard_uncertainty_si=tuple(self.standard_uncertainty_si[i] for i in keep),
            correlation=tuple(tuple(float(c) for c in row[:i]) for i, row in enumerate(matrix)),
        )

    def matrix_of_correlation(self) -> Array:
        """The whole matrix (p, p)."""
        matrix = np.eye(len(self.parameters))
        for i, row in enumerate(self.correlation):
            matrix[i, :i] = matrix[:i, i] = row
        return matrix


class ArmFile(_Part):
    """A validated arm file."""

    schema_: Literal["aacmm-pin/arm/1"] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1)]
    source: str = ""
    convention: Literal["standard-dh", "modified-dh"]
    reference_temperature_c: FiniteFloat = 20.0
    gravity_m_s2: Vector3 = (0.0, 0.0, -9.81)
    joints: Annotated[list[Row], Field(min_length=1)]
    stylus: Stylus | None = None
    effects: list[EffectEntry] = Field(default_factory=list)
    covariance: Covariance | None = None

    @model_validator(mode="after")
    def _has_a_joint(self) -> ArmFile:
        if all(row.fixed for row in self.joints):
            raise ValueError("every row is fixed, expected at least one joint")
        return self

    @property
    def dh(self) -> DHTable:
        """The DH table in SI."""
        rows = np.array([[r.a_mm * MM, r.d_mm * MM, r.alpha_rad, r.theta_offset_rad] for r in self.joints])
        return table(rows, self.convention, [not r.fixed for r in self.joints])

    @property
    def moving_rows(self) -> list[Row]:
        """The rows that have a joint, in order."""
        return [row for row in self.joints if not row.fixed]

    @property
    def limits(self) -> Array:
        """Joint limits, (nq, 2) [rad]."""
        return np.array([row.limits_rad for row in self.moving_rows], dtype=np.float64)

    @property
    def encoder_noise(self) -> Array | None:
        """Standard uncertainty of one reading, (nq,) [rad]; None where the file states it for no joint."""
        noise = [row.encoder_noise_rad for row in self.moving_rows]
        return None if all(u is None for u in noise) else np.array([u or 0.0 for u in noise])

    def dh_parameters(self) -> tuple[Parameter, ...]:
        """The four values of every row in the order of :meth:`DHTable.sensitivity`; rows without uncertainty have u = 0."""
        parameters, known = [], self._calibrated_u()
        for number, row in enumerate(self.joints, start=1):
            widths = row.uncertainty
            for kind, field, unit, scale in zip(KINDS, _FIELDS, ("m", "m", "rad", "rad"), (MM, MM, 1, 1), strict=True):
                half = None if widths is None else getattr(widths, field) * scale
                value = getattr(row, field) * scale
                name = f"{kind}{number}"
                if name in known:
                    half, u = COVERAGE_FACTOR * known[name], known[name]
                    parameters.append(Parameter(name, kind, number, unit, value, half, u))
                else:
                    parameters.append(Parameter.bounded(name, kind, number, unit, value, half))
        return tuple(parameters)

    def _calibrated_u(self) -> dict[str, float]:
        known = self.covariance
        return {} if known is None else dict(zip(known.parameters, known.standard_uncertainty_si, strict=True))


_FIELDS = ("a_mm", "d_mm", "alpha_rad", "theta_offset_rad")


def bundled_arms() -> list[str]:
    """Names of the arms that come with the package."""
    folder = importlib.resources.files("aacmm_pin.arm") / "bundled"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_arm_file(name_or_path: str | Path) -> ArmFile:
    """Read a bundled arm by name (``sino6``) or an arm file by path.

    Raises:
        UnknownNameError: neither a bundled name nor a file; lists the names.
        ArmFileError: the file is not TOML, or a key is unknown, missing, of the wrong type or out of range.
    """
    name = str(name_or_path)
    if name in bundled_arms():
        resource = importlib.resources.files("aacmm_pin.arm") / "bundled" / f"{name}.toml"
        return parse_arm_file(resource.read_bytes(), f"{name}.toml")
    path = Path(name_or_path)
    if path.is_dir():
        raise ArmFileError(name, "", "is a folder, expected an arm file, *.toml")
    if not path.is_file():
        if path.suffix == ".toml" or path.exists():
            raise ArmFileError(name, "", "no such file")
        raise UnknownNameError("arm", name, bundled_arms(), "or the path of an arm file, *.toml")
    try:
        return parse_arm_file(path.read_bytes(), name)
    except OSError as error:
        raise ArmFileError(name, "", f"cannot be read: {error.strerror}") from None


def parse_arm_file(content: bytes, path: str) -> ArmFile:
    """Validate the content of an arm file; ``path`` is only for messages."""
    try:
        data = tomllib.loads(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise ArmFileError(path, "", f"not UTF-8 text (byte {error.start})") from None
    except tomllib.TOMLDecodeError as error:
        raise ArmFileError(path, "", f"not TOML: {error}") from None
    except RecursionError:
        raise ArmFileError(path, "", "not TOML: nested too deep") from None
    try:
        return ArmFile.model_validate(data)
    except ValidationError as error:
        raise _explained(error, path) from None


def _explained(error: ValidationError, path: str) -> ArmFileError:
    """Say in one line a problem what came and what was expected, and where."""
    problems = [_problem(item) for item in error.errors()]
    key, message = problems[0]
    rest = "".join(f"\n{path}: {k}: {m}" if k else f"\n{path}: {m}" for k, m in problems[1:])
    return ArmFileError(path, key, message + rest)


def _problem(item: Any) -> tuple[str, str]:
    key = ""
    for part in item["loc"]:
        key += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if key else str(part)
    match item["type"]:
        case "extra_forbidden":
            model = _model_at(item["loc"])
            known = sorted(field.alias or name for name, field in model.model_fields.items())
            return key, f"unknown key; known here: {', '.join(known)}"
        case "missing":
            return key, "missing"
        case "value_error":
            return key, str(item["ctx"]["error"])
        case _:
            expected = item["msg"].removeprefix("Input should be ")
            return key, f"is {item['input']!r}, expected {expected}"


def _model_at(location: tuple[Any, ...]) -> type[_Part]:
    names = [part for part in location[:-1] if isinstance(part, str)]
    parts: dict[str, type[_Part]] = {
        "joints": Row,
        "uncertainty": Uncertainty,
        "stylus": Stylus,
        "effects": EffectEntry,
        "covariance": Covariance,
    }
    return parts.get(names[-1], ArmFile) if names else ArmFile
