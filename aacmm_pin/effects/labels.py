"""Causes of error in words, and their values in units for readers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.units import DEG, LARGE_IN_MICRO, MM
from aacmm_pin.arm import COVERAGE_FACTOR, Arm, axis
from aacmm_pin.effects.effect import Effect, Reading

FREE_PHASE = 90.0
"""Larger U of a phase: the phase is unknown [°]."""
PLACE_WORDS = {
    "marker": "target",
    "link": "body",
    "link_bending": "tube",
    "torsional_windup": "tube",
}
"""Words for places, by the cause or the field; default the field."""
PLURAL = {"body": "bodies"}
WHOLE_ARM = {"thermal_expansion": "the arm"}
"""Words for the whole arm, of causes that may have a place."""
FEW_VALUES = 8
MOST_DECIMALS = 6


def cause_in_words(kind: type[Effect]) -> str:
    """The name of a cause in outputs."""
    return kind.words or kind.cause.replace("_", " ")


def name_in_words(effect: Effect, arm: Arm | None = None) -> str:
    """Name and place of a cause: ``encoder gain of joint 5``, ``distance d of tool row 7``."""
    words, location = cause_in_words(type(effect)), location_in_words(effect, arm)
    return f"{words} of {location}" if location else words


def location_in_words(effect: Effect, arm: Arm | None = None) -> str:
    """Where a cause acts: ``joint 5``, ``tool row 7``, ``seat A``; "" if its name states that."""
    if effect.place is None:
        return WHOLE_ARM.get(effect.cause, "")
    return f"{_place_words(effect, arm)} {effect.place}"


def in_words(effect: Effect, arm: Arm | None = None) -> str:
    """The name and the place of a cause, with its order or time."""
    details = f" ({', '.join(effect.details)})" if effect.details else ""
    return name_in_words(effect, arm) + details


def several_in_words(effects: Sequence[Effect], arm: Arm | None = None) -> str:
    """Causes as text, grouped by cause: ``error curve of joints 1, 2 and 3``."""
    groups: dict[tuple[type[Effect], str], list[Effect]] = {}
    for effect in effects:
        place_words = "" if effect.place is None else _place_words(effect, arm)
        groups.setdefault((type(effect), place_words), []).append(effect)
    texts = []
    for (cause, place_words), group in groups.items():
        places = {effect.place for effect in group if effect.place is not None}
        if len(places) < len(group) or len(group) == 1:
            texts += [in_words(effect, arm) for effect in group]
        else:
            numbers = [str(place) for place in sorted(places)]
            plural = PLURAL.get(place_words, f"{place_words}s")
            texts.append(f"{cause_in_words(cause)} of {plural} {listed(numbers)}")
    return listed(texts)


def _place_words(effect: Effect, arm: Arm | None) -> str:
    location = str(effect.location_field())
    if arm is not None and location == "joint" and effect.row is not None:
        return row_in_words(effect.row, arm)
    return PLACE_WORDS.get(effect.cause) or PLACE_WORDS.get(location, location)


def row_in_words(row: int, arm: Arm) -> str:
    """The word for a row (from 1): ``joint``, ``row`` if rigid, ``tool row`` after the joints."""
    moving = arm.chain.moving_rows()
    return "joint" if row in moving else "row" if row < moving[-1] else "tool row"


def slides(effect: Effect, arm: Arm) -> bool:
    """Whether the values are of a prismatic joint: in metres in place of radians."""
    if effect.location_field() != "joint" or effect.row is None:
        return False
    number = int(arm.chain.joint[axis(effect.row)])
    may_slide = effect.along_slide and all(term.unit == "rad" for term in effect.terms)
    return may_slide and number >= 0 and bool(arm.chain.prismatic[number])


def values_with_u(effect: Effect, covariance: Array) -> dict[str, tuple[float, float]]:
    """The values of a cause with their u from the ``covariance`` ``(p, p)``, by keys of files."""
    jacobian = effect.file_jacobian()
    variance = np.einsum("ij,jk,ik->i", jacobian, covariance, jacobian)
    u = np.sqrt(np.maximum(variance, 0.0)).tolist()
    values = effect.file_values().items()
    return {key: (value, its_u) for (key, value), its_u in zip(values, u, strict=True)}


def known_range_in_words(effect: Effect) -> str:
    """The known range of a cause after a comma; "" for all angles."""
    if effect.known_range is None:
        return ""
    low, high = effect.known_range
    degrees = f"{low / DEG:g}° to {high / DEG:g}°"
    return f", which is known from {low:g} to {high:g} rad ({degrees})"


def values_in_words(
    effect: Effect, values: Mapping[str, tuple[float, float]], slides: bool = False
) -> str:
    """The values with U (k = 2) as texts by key; in metres if the joint ``slides``."""
    if len(values) > FEW_VALUES:
        return f"curve with {len(values)} values"
    forms = effect.readings()
    if slides:
        for key, form in forms.items():
            forms[key] = form._replace(unit=form.unit.replace("rad", "m"))
    in_micro = [key for key in values if forms[key].unit == "µm"]
    sizes = [abs(values[key][0]) * forms[key].factor for key in in_micro]
    if max(sizes, default=0.0) >= LARGE_IN_MICRO:
        for key in in_micro:
            forms[key] = forms[key]._replace(unit="mm", factor=forms[key].factor * MM)
    pairs = values.items()
    return ", ".join(_value(forms[key], value, COVERAGE_FACTOR * u) for key, (value, u) in pairs)


def _value(form: Reading, value: float, expanded: float) -> str:
    """U with two digits, the value to the same place; a bound if U exceeds it; no unknown phase."""
    value = value * form.factor
    expanded = expanded * form.factor
    if form.unit == "°" and expanded > FREE_PHASE:
        return f"{form.name} not determined"
    if abs(value) < expanded < np.inf and form.unit != "°":
        bound = float(f"{abs(value) + expanded:.2g}")
        return f"{form.name} below {bound:g} {form.unit.lstrip('·')} (95 %)".strip()
    if not 0.0 < expanded < np.inf:
        text = f"{value:.4g}"
    else:
        digits = min(1 - int(np.floor(np.log10(expanded))), MOST_DECIMALS)
        spec = f"z.{max(digits, 0)}f"
        text = f"{round(value, digits):{spec}} ± {round(expanded, digits):{spec}}"
    if form.unit.startswith("·"):
        text = f"({text})"
    space = "" if form.unit[:1] in ("", "°", "·") else " "
    return f"{form.name} {text}{space}{form.unit}"


def probability(value: float) -> str:
    """A probability with three decimals, "> 0.999" or "< 0.001"."""
    return "> 0.999" if value > 0.999 else "< 0.001" if value < 0.001 else f"{value:.3f}"


def typical_magnitude_in_words(effect: Effect) -> str:
    """The different typical magnitudes of the parameters: ``10 µrad/(N·m)``."""
    sizes = []
    for term in effect.terms:
        unit, size = term.unit_read
        sizes.append(f"{term.typical / size:.3g} {unit}")
    return ", ".join(dict.fromkeys(sizes))


def listed(items: Sequence[str]) -> str:
    """Items as text: ``a, b and c``."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"
