"""Causes of error in words, and their values in the units that people read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aacmm_pin._support.units import DEG
from aacmm_pin.arm.file import COVERAGE_FACTOR
from aacmm_pin.effects import CAUSES, Effect

FEW_VALUES = 8
"""More parameters than this are no reading."""
NAMES = {
    "joint_zero_offset": "zero offset",
    "link_length": "length a",
    "joint_distance": "distance d",
    "link_twist": "twist α",
    "link_tilt": "tilt β",
    "joint_placement": "placement",
    "encoder_eccentricity": "encoder eccentricity",
    "encoder_ellipticity": "encoder ellipticity (twice per turn)",
    "joint_periodic_error": "periodic error",
    "joint_error_curve": "error curve",
    "encoder_gain": "encoder gain",
    "encoder_slip": "encoder slip",
    "joint_compliance": "compliance under gravity",
    "bearing_tilt": "bearing tilt under gravity",
    "joint_hysteresis": "hysteresis",
    "zero_drift": "drift of the zero",
    "torsional_windup": "torsional wind-up",
    "link_bending": "bending",
    "base_compliance": "tilting stand (base compliance)",
    "thermal_expansion": "thermal expansion",
    "counterbalance": "counterbalance error",
    "stylus_offset": "stylus offset",
    "stylus_bending": "stylus bending",
    "seat_error": "error of the stated place",
    "reference_frame": "error of the reference frame",
}
"""Words for the causes; one that somebody registered goes by its name."""
OF_TUBES = ("link_bending", "torsional_windup")
UNITS = {
    "_rad_per_nm2": ("µrad/(N·m²)", 1e6),
    "_rad_per_nm": ("µrad/(N·m)", 1e6),
    "_per_k": ("µm/(m·K)", 1e6),
    "_rad": ("µrad", 1e6),
    "_mm": ("µm", 1e3),
    "gain": ("·10⁻⁶", 1e6),
}
"""How a described value ends, the unit that people read, and how many of it make one."""


def label_in_words(label: str) -> str:
    """``encoder_gain:5`` as ``encoder gain of joint 5``; a covariate as a dependence on it."""
    cause, _, place = label.partition(":")
    if cause not in CAUSES:
        return f"dependence on {label}"
    words = NAMES.get(cause, cause.replace("_", " "))
    if not place:
        return words if cause != "thermal_expansion" else "thermal expansion of the arm"
    what = "seat" if cause == "seat_error" else "tube" if cause in OF_TUBES else "joint" if place.isdigit() else "target"
    return f"{words} of {what} {place}"


def in_words(effect: Effect) -> str:
    """The cause, where it sits, and its order or time."""
    inner = []
    if (order := getattr(effect, "order", None)) is not None:
        inner.append(f"{order:.4g} periods per turn")
    if (time := getattr(effect, "time_s", None)) is not None:
        inner.append(f"at {time / 60:.1f} min")
    if (constant := getattr(effect, "time_constant_s", None)) is not None:
        inner.append(f"time constant {constant / 60:.0f} min")
    return label_in_words(effect.label) + (f" ({', '.join(inner)})" if inner else "")


def several_in_words(effects: Sequence[Effect]) -> str:
    """Causes in a row; those of one kind together, ``error curve of joints 1, 2 and 3``."""
    return labels_in_words({effect.label: in_words(effect) for effect in effects})


def labels_in_words(words: Mapping[str, str]) -> str:
    """The same of labels, each with its words for where it is the only one of its kind."""
    kinds: dict[str, list[str]] = {}
    for label in words:
        kinds.setdefault(label.partition(":")[0], []).append(label)
    found = []
    for labels in kinds.values():
        if len(labels) == 1:
            found.append(words[labels[0]])
            continue
        places = [label.partition(":")[2] for label in labels]
        found.append(f"{label_in_words(labels[0]).removesuffix(f' {places[0]}')}s {listed(sorted(places))}")
    return listed(found)


def values_in_words(values: Mapping[str, tuple[float, float]]) -> str:
    """The same of described values with their u, by their names."""
    if len(values) > FEW_VALUES:
        return f"free curve of {len(values)} values"
    return ", ".join(_value(key, value, COVERAGE_FACTOR * u) for key, (value, u) in values.items())


def _value(key: str, value: float, expanded: float) -> str:
    if key == "phase_rad":
        name, unit, factor = "phase", "°", 1 / DEG
    else:
        ending = next((e for e in UNITS if key.endswith(e)), "")
        unit, factor = UNITS.get(ending, ("", 1.0))
        name = (key.removesuffix(ending) or key).replace("_", " ").strip()
    value, expanded = value * factor, expanded * factor
    if not np.isfinite(expanded) or expanded <= 0:
        return f"{name} {value:.4g} {unit}".strip()
    digits = int(np.clip(1 - np.floor(np.log10(expanded)), 0, 6))
    return f"{name} {value:.{digits}f} ± {expanded:.{digits}f} {unit}".replace(" °", "°").replace(" ·", "·").strip()


def listed(items: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""
