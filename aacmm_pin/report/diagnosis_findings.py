"""What a diagnosis found, in sentences for people; the numbers are those of :class:`Diagnosis`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM
from aacmm_pin.calibration.problem import geometric_parameters
from aacmm_pin.diagnosis import Diagnosis, Finding, OddGroup
from aacmm_pin.diagnosis.result import described
from aacmm_pin.effects import Effect, EncoderSlip, SeatError
from aacmm_pin.effects.labels import in_words as in_words
from aacmm_pin.effects.labels import label_in_words as label_in_words
from aacmm_pin.effects.labels import labels_in_words as labels_in_words
from aacmm_pin.effects.labels import listed as listed
from aacmm_pin.effects.labels import several_in_words as several_in_words
from aacmm_pin.effects.labels import values_in_words

CHANCE = 0.01
"""Structure with less chance than this is not nothing."""
BEYOND = 1.3
"""So many times what was predicted is worth a reader's attention."""
SURE = 0.95
"""A cause less probable than this is in doubt."""
PARTS = {"seats": "seats", "blocks": "blocks of joint space"}
"""What is left out in turn, in words."""
LEFT_OUT_SEATS = (
    "A seat left out is judged by its stated coordinates with all their noise, so this gain is less than that in "
    "the records that were used."
)
"""Why the gain on seats looks small."""


def geometric(result: Diagnosis, finding: Finding) -> bool:
    """Whether it is a value of the arm's own geometry."""
    return bool(geometric_parameters(result.extended.problem.model.arm, finding.effect))


def parameters_in_words(finding: Finding) -> str:
    """Values with U (k = 2) in the units that people read; the smaller of them would be lost in SI."""
    return values_in_words(finding.parameters)


def effect_values(effect: Effect) -> dict[str, tuple[float, float]]:
    """Described values of a cause with u, as of a finding; its parameters count as independent."""
    return described(effect, np.diag(np.square(effect.u)))


def verdict_in_words(result: Diagnosis) -> str:
    """One sentence: what the simulation lacks, or that it lacks nothing, or that nobody can say."""
    name, left, wrong = result.model.arm.name, _left(result), _wrong(result.findings, result)
    if result.verdict == "unexplained":
        wrong = _wrong([f for f in result.findings if f.probability >= SURE], result)
        return f"{name}: {_not_explained(result)}{f' Beside it, {wrong}.' if wrong else ''}"
    if result.verdict == "inconclusive":
        return f"{name}: {_inconclusive(result, wrong)}"
    if result.verdict == "no-discrepancy":
        return f"{name}: no cause is missing in the simulation. Once the arm is recalibrated, {left}."
    if result.verdict == "ambiguous":
        rivals = "; ".join(_doubt(f) for f in result.findings if f.probability < SURE)
        which = "which" if len(result.findings) == 1 else "all of them"
        return f"{name}: {wrong}, but these records do not settle {which}: {rivals}."
    none = "" if _causes(result.findings, result) else "no cause is missing in the simulation, but "
    return f"{name}: {none}{wrong}. With {'it' if len(result.findings) == 1 else 'these'}, {left}."


def _inconclusive(result: Diagnosis, wrong: str) -> str:
    """Why these records do not settle anything."""
    if not result.converged:
        return f"the search did not converge ({result.converge_note}), so nothing can be concluded."
    if not result.extended.tells_noise:
        return "there are too few records to tell the noise, and so to tell a cause from it."
    if not result.findings:
        seen, of = result.visible
        if seen > of / 2:
            return f"no cause was found, but something may be left (p = {p_in_words(result.unexplained.p_value)})."
        return f"too few records to say: of {of} causes of usual size they would show {seen}, and show none."
    doubtful = [f for f in result.findings if not f.borne_out]
    if not doubtful:
        left = p_in_words(result.unexplained.p_value)
        return f"these records suggest that {wrong}, but something else may be left beside it (p = {left})."
    which = several_in_words([f.effect for f in doubtful])
    return f"these records suggest that {wrong}, but held-out records do not bear out {which}."


def _not_explained(result: Diagnosis) -> str:
    depends = listed(list(result.unexplained.depends_on))
    if not depends:
        more = f"{result.rms['extended'] / result.noise:.1f} times the stated noise"
        return f"the residuals stay {more}, and nothing in the file tells on what that depends."
    odd = [group.name for group in result.unexplained.groups if group.name in result.unexplained.depends_on]
    if odd:
        return f"{listed(odd)} does not agree with the other records."
    return f"something in these records depends on {depends}, and no known cause has its shape."


def _causes(findings: Sequence[Finding], result: Diagnosis) -> list[Effect]:
    """Findings that are causes of their own, and no value that the simulation has but has wrong."""
    return [f.effect for f in findings if not (geometric(result, f) or isinstance(f.effect, SeatError))]


def _wrong(findings: Sequence[Finding], result: Diagnosis) -> str:
    """What the simulation lacks, and which values it has wrong: of the geometry, of the places of seats."""
    causes = _causes(findings, result)
    moved = [f.effect for f in findings if geometric(result, f)]
    seats = sorted(f.effect.seat for f in findings if isinstance(f.effect, SeatError))
    found = []
    if causes:
        number = "one cause" if len(causes) == 1 else f"{len(causes)} causes"
        found.append(f"the simulation lacks {number}, {several_in_words(causes)}")
    if moved:
        found.append(f"its geometry is off by unusually much for what was stated: {several_in_words(moved)}")
    if seats:
        one = len(seats) == 1
        found.append(f"the stated place{'' if one else 's'} of {listed(seats)} {'is' if one else 'are'} off")
    return ", and ".join(found)


def _doubt(finding: Finding) -> str:
    others = [f"{label_in_words(a.label)} {probability(a.probability)}" for a in finding.aliases if a.probability >= 0.01]
    own = f"{in_words(finding.effect)} has probability {probability(finding.probability)}"
    return f"{own}, {listed(others)}" if others else own


def probability(value: float) -> str:
    """Three digits, and no certainty."""
    return "> 0.999" if value > 0.999 else "< 0.001" if value < 0.001 else f"{value:.3f}"


LEAST_P = 1e-300


def p_in_words(value: float) -> str:
    """One digit; a chance that no computer number holds is less than the least."""
    return f"{value:.1g}" if value > LEAST_P else f"< {LEAST_P:g}"


def group_in_words(group: OddGroup) -> str:
    """That a group does not agree with the other records, by how much, and what to do."""
    return (
        f"The {group.records} records of {group.name} do not agree with the others, which predict them "
        f"{group.times:.1f} times as far off as one another (p {_equals(group.p_value)}): look at its set-up."
    )


def _equals(p_value: float) -> str:
    text = p_in_words(p_value)
    return text if text.startswith("<") else f"= {text}"


def noise_in_words(result: Diagnosis) -> str:
    """Where the noise comes from if it was not stated; "" where it was."""
    if result.extended.stated:
        return ""
    return (
        "The noise was not stated in full: the scatter that the extended arm leaves is taken for it, so that the "
        "extended arm meets it by itself."
    )


def most_off_in_words(result: Diagnosis, table: pd.DataFrame) -> str:
    """Where each model is off most, in times what is predicted for it.

    Args:
        result: the diagnosis.
        table: residuals by group, with ``where`` in words.
    """
    if table.empty:
        return "There are too few records to compare groups of them."
    first = table.iloc[int(np.argmax(table["times_predicted"]))]
    stated = "that the arm's stated uncertainties and the noise predict"
    if not result.before.problem.model.covariance().any():
        stated = "that the noise gives by itself (the arm states no uncertainty)"
    text = (
        f"The simulation is off most at {first['where']}: {first['simulation_mm']:.4f} mm RMS, "
        f"{first['times_predicted']:.1f} times the {first['predicted_mm']:.4f} mm {stated}."
    )
    if first["times_predicted"] <= BEYOND:
        allowed = "No part is off by much more than the arm's stated uncertainties allow"
        text = f"{allowed}: what is wrong shows beside them only after a recalibration. {text}"
    times = {name: table[f"{name}_mm"] / table["noise_mm"] for name in ("recalibrated", "extended")}
    after, last = [
        f"up to {values.max():.1f} times the noise ({table['where'].iloc[int(np.argmax(values))]})"
        for values in times.values()
    ]
    return f"{text} Recalibrated, the arm is off by {after}; extended, by {last}."


def slip_in_words(result: Diagnosis, slip: EncoderSlip) -> str:
    """Between which records a slip was."""
    time = result.extended.problem.measurements.conditions.require("time", slip.label)[result.extended.used]
    before, after = time[time < slip.time_s], time[time >= slip.time_s]
    if not (before.size and after.size):
        return ""
    return f"The fit puts it between the records at {before.max() / 60:.1f} min and {after.min() / 60:.1f} min."


def unexplained_in_words(result: Diagnosis) -> str:
    """What structure is left, or that none is."""
    open_ = result.unexplained
    p = _equals(open_.p_value)
    covariates = [name for name in open_.depends_on if name not in {group.name for group in open_.groups}]
    if not covariates and open_.groups:
        return f"No column of the file tells what is left, but not all groups of records agree. {left_in_words(result)}"
    if not covariates and open_.p_value < CHANCE:
        return f"Something is left beyond chance (p {p}), but no single column over which it holds. {left_in_words(result)}"
    if not covariates:
        return (
            "Nothing that depends on a joint's angle, time or any other column is left beyond chance "
            f"(p {p}, where less than {CHANCE:g} would be). {left_in_words(result)}"
        )
    worth = (
        ""
        if open_.gain is None
        else (f" On held-out records it takes {100 * open_.gain:z.0f} % off what the causes alone leave.")
    )
    return (
        f"The residuals depend on {listed(covariates)} (p {p}) in a way that no cause of the library has. The "
        "correction over it is smooth and only describes it; it is no cause, and not in the extended arm."
        f"{worth}"
    )


def _left(result: Diagnosis) -> str:
    """What is left of the residuals."""
    fit = result.extended
    if not fit.stated and fit.scatters:
        return (
            f"the residuals scatter by {fit.unmodelled / MM:.4f} mm per coordinate beyond what was stated, "
            "noise and what is still missing together"
        )
    if fit.scatters:
        return f"the residuals are still larger than the stated noise, by {fit.unmodelled / MM:.4f} mm per coordinate"
    return "the arm agrees with the records to within their noise"


def line_to_remember(result: Diagnosis) -> str:
    """Sizes of residuals by the three models, the noise floor, and the gain on held-out records."""
    sizes = {name: f"{value / MM:.4f} mm" for name, value in result.rms.items()}
    text = (
        f"RMS {sizes['simulation']} simulated → {sizes['recalibrated']} recalibrated → {sizes['extended']} extended; "
        f"noise alone {sizes['noise']}."
    )
    return text if result.held_out is None else f"{text} {gain_in_words(result)}"


def gain_in_words(result: Diagnosis) -> str:
    """What the extended model is worth on records that it never saw."""
    held = result.held_out
    if held is None:
        return "Nothing was held out, so that nothing is known of the gain on other records."
    low, high = held.interval
    where, interval = f"On held-out {PARTS[held.kind]}", f"(95 %: {100 * low:z.0f} to {100 * high:z.0f} %)"
    arm = "the extended arm"
    if not result.findings:
        return f"{where} there is nothing to gain beside recalibration."
    if round(100 * low) <= 0 <= round(100 * high):
        return f"{where} {arm} is not better than the recalibrated one beyond doubt: {100 * held.gain:z.0f} % {interval}."
    less = "less" if low > 0 else "more"
    return f"{where} {arm} is off by {100 * abs(held.gain):.0f} % {less} than the recalibrated one {interval}."


def seats_in_words(result: Diagnosis) -> str:
    """What residuals cannot show of the error of a seat; "" where none was found."""
    if not any(isinstance(f.effect, SeatError) for f in result.findings):
        return ""
    return (
        "These residuals are taken from where the records of a seat together put it, so that they hardly show an error of "
        "its stated place; and a seat that is left out whole says nothing of its own, so that the gain does not show it "
        "either. Sections 3 and 5 do."
    )


def left_in_words(result: Diagnosis) -> str:
    """What is left once the causes are known, as a sentence."""
    text = _left(result)
    return f"{text[:1].upper()}{text[1:]}."
