"""A plan of measurements as a document, in one line, and as advice with its command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aacmm_pin._support.units import MM
from aacmm_pin.arm import Arm, bundled_arms
from aacmm_pin.effects import GivenCause, GivenModel, probability, text_of
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import Measurements
from aacmm_pin.planning import MeasurementPlan, PlannedScheme, Tried, plan_measurements
from aacmm_pin.report.calibration_plan import where_to_go
from aacmm_pin.report.document import Document, Format, Notes, Paragraph, Table, document_of
from aacmm_pin.report.numbers import capital, three_digits

RIGHT = "probability of the right decision"
CONSIDERED = f"Set-ups that the plan considered, with the {RIGHT}"
PAIRS = "Pairs of causes, and the increase T of χ² if the model has the wrong cause of a pair"
NOISE_OPTIONS = {"--u-reference-mm": "reference_noise", "--probe-noise-mm": "probe_noise"}
DEFAULTS = {"scheme": "free", "reference_frame": "base", "target": "tip"}
"""Keywords of a plan whose option need not be written with these values."""
QUICK = 200
"""Postures that are enough to state whether a plan would help; the plan itself has more."""
LEAST_CHANGE = 0.005
"""A probability of a right decision that grows by less is not worth new records."""
FORMS: dict[str, Format] = {"T": three_digits}
PAIRS_LISTED = 8
"""Pairs of causes that are listed; the JSON has all."""


@document_of.register
def plan_document(plan: MeasurementPlan) -> Document:
    """The plan; its records stand in :attr:`MeasurementPlan.records`."""
    tried = [*map(_tried, plan.tried)]
    considered = pd.DataFrame(tried if len(tried) > 1 else [])
    set_ups = Table(considered, CONSIDERED, FORMS)
    pairs = Table(_pairs(plan), PAIRS, FORMS, most=PAIRS_LISTED)
    return Document(
        "Plan",
        [
            Paragraph(f"{plan}.", head="Plan:"),
            set_ups,
            pairs,
            *where_to_go(plan),
            Notes(plan.notes),
        ],
    )


def _tried(tried: Tried) -> dict[str, Any]:
    chance = None if tried.why_not else probability(tried.power.probability)
    row = {"set-up": tried.words, "T": tried.power.least, "probability": chance}
    return row | {"obstacle": tried.why_not}


def _pairs(plan: MeasurementPlan) -> pd.DataFrame:
    """Pairs of causes that postures can distinguish, worst first; empty if the plan is for one
    pair.
    """
    if plan.pairs is None:
        return pd.DataFrame()
    heads = {"cause": "cause", "other": "other cause", "T": "T", "told": "distinguished"}
    open_ = plan.pairs["why_not"] == ""
    return plan.pairs.loc[open_, [*heads]].rename(columns=heads)


def plan_line(plan: MeasurementPlan) -> str:
    """How many records in which set-up, and what they decide."""
    one, other = (effect.label for effect in plan.split)
    if plan.asked:
        what = f"to distinguish {one} from {other}"
    else:
        causes = "all causes whose effects differ in this set-up"
        what = f"to distinguish {causes}, of which {one} and {other} are the most similar"
    if plan.before is not None and not plan.needed:
        return (
            f"The {plan.existing} existing records are enough {what}. The {RIGHT} is "
            f"{probability(plan.before.probability)}. You can use the {len(plan.records)} planned "
            "records to check the result"
        )
    how = capital(plan.setup) if plan.set_up else "The set-up does not change"
    text = f"Take {len(plan.records)} records {what}. {how}. {_power(plan)}"
    poor = [f". In the set-up '{one.words}', {one.why_not}" for one in plan.tried if one.why_not]
    return text + "".join(poor)


def _power(plan: MeasurementPlan) -> str:
    """What the planned records decide."""
    if plan.after.same:
        return (
            "No set-up that the plan considered distinguishes both causes. If both correct the "
            "arm in the same way, use the extended arm with either cause"
        )
    text = f"The {RIGHT} is {probability(plan.after.probability)}"
    if plan.before is not None:
        text += f", and {probability(plan.before.probability)} with only the existing records"
    increase = f"T = {three_digits(plan.after.least)}"
    text += f". If the model has the wrong cause, χ² increases by about {increase}"
    return text + ("" if plan.decided else f". The probability is too small to decide{_more(plan)}")


def _more(plan: MeasurementPlan) -> str:
    """How many records would decide; "" if that is not known."""
    beside = f" in addition to the {plan.existing} existing ones" if plan.existing else ""
    enough = f"; about {plan.enough} new records{beside} would be enough"
    return "" if plan.enough is None else enough


def plan_advice(plan: MeasurementPlan, options: Sequence[str] = ()) -> str:
    """What to do to distinguish the two causes of a plan, and the command that plans it.

    Args:
        plan: the plan.
        options: of the command, besides the causes and the number of records.
    """
    one, other = plan.split
    if plan.after.same:
        pair = f"{one.label} from {other.label}"
        why = plan.tried[-1].why_not
        return f"no set-up that the plan considered distinguishes {pair}, because {why}"
    before = 0.5 if plan.before is None else plan.before.probability
    if plan.before is not None and plan.after.probability - before < LEAST_CHANGE:
        return (
            f"take more records, at other postures, to distinguish {one.label} from {other.label}, "
            "because a plan for these two causes alone found no useful records of the same kind"
        )
    odds = f"becomes {probability(plan.after.probability)}"
    if not plan.decided:
        more = _more(plan)
        if not more:
            return (
                f"take more records, at other postures, to distinguish {one.label} from "
                f"{other.label}, because {len(plan.records)} records of the same kind are too few"
            )
        odds += more
    if plan.changes_arm:
        odds += "; diagnose the new records with set_up.toml, separately from the existing ones"
    where = f", and {plan.setup}" if plan.set_up else ""
    return (
        f"to distinguish {one.label} from {other.label}, take {len(plan.records)} records at "
        f"postures in which their effects differ most{where}: {_command(plan, options)} "
        f"(a quick plan for these two causes alone predicts that the {RIGHT} {odds})"
    )


def _command(plan: MeasurementPlan, asked: Sequence[str]) -> str:
    """The command that makes such a plan."""
    one, other = map(text_of, plan.split)
    name = plan.model.arm.name.lower()
    arm = name if name in bundled_arms() else "ARM.toml"
    options = [*asked, "--arm-out set_up.toml"] if plan.changes_arm else asked
    asks = f"--causes {one} {other} --records {len(plan.records)}"
    return " ".join(["aacmm-pin plan distinguish", arm, asks, *options, "-o plan.csv"])


def advice(
    model: GivenModel,
    split: tuple[GivenCause, GivenCause],
    existing: Measurements,
    **setup: Any,
) -> str:
    """:func:`plan_advice` of a quick plan.

    New records are taken as the old ones were: at their seats if most of them have one, else each
    with its own coordinates. If no plan can be made the sentence states why; nothing is raised.

    Args:
        model: the arm.
        split: the two causes, with their values where they are estimated.
        existing: the records that leave the two alike.
        setup: how records are taken, by keywords of :func:`plan_measurements`.
    """
    scheme: PlannedScheme = "seats" if mostly_seats(existing) else "free"
    asked: dict[str, Any] = {"scheme": scheme} | setup
    try:
        plan = plan_measurements(
            model, split, existing=existing, postures=QUICK, progress=False, **asked
        )
        return plan_advice(plan, _options(plan.model.arm, asked))
    except AacmmError as error:
        one, other = (cause if isinstance(cause, str) else cause.key for cause in split)
        return f"the package could not plan records that distinguish {one} from {other}: {error}"


def mostly_seats(records: Measurements) -> bool:
    """Whether most records are of seats."""
    seat = records.conditions.seat
    return seat is not None and bool(np.mean(seat != "") > 0.5)


def _options(arm: Arm, asked: Mapping[str, Any]) -> list[str]:
    """Options of the command ``aacmm-pin plan`` that ask for the same, as far as they can."""
    values = {name: asked.get(name, usual) for name, usual in DEFAULTS.items()}
    unusual = [name for name, usual in DEFAULTS.items() if values[name] != usual]
    options = [f"--{name.replace('_', '-')} {values[name]}" for name in unusual]
    for option, name in NOISE_OPTIONS.items():
        noise = asked.get(name)
        if noise is not None:
            options.append(f"{option} {noise / MM:g}")
    options += _encoder_option(arm, asked.get("encoder_noise"))
    if not asked.get("prior", True):
        options.append("--no-prior")
    return options


def _encoder_option(arm: Arm, noise: ArrayLike | None) -> list[str]:
    """The noise of readings [rad], if it is one number and not that of the arm."""
    readings = np.empty(0) if noise is None else np.unique(noise)
    stated = arm.encoder_noise
    known = stated is not None and np.array_equal(readings, np.unique(stated))
    if readings.size != 1 or known:
        return []
    return [f"--encoder-noise {readings[0]:g}"]
