"""A diagnosis as a document: verdict, where the simulation is wrong, causes, gain on held-out
records, what is left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM, UM
from aacmm_pin.arm.arm import Arm
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.calibration.fit import NO_SCATTER
from aacmm_pin.calibration.result import residuals_by_record
from aacmm_pin.calibration.shared_exclusions import exclusions_of
from aacmm_pin.diagnosis import (
    THRESHOLDS,
    Alias,
    Branches,
    Diagnosis,
    Finding,
    Gain,
    ScatteredReadings,
    SharedError,
    Unexplained,
)
from aacmm_pin.diagnosis.unexplained import BACKGROUND
from aacmm_pin.effects import (
    Discrepancy,
    Effect,
    State,
    corrects_seat,
    in_words,
    listed,
    name_in_words,
    probability,
    sensitivity,
    several_in_words,
    strongest_waves,
    values_in_words,
)
from aacmm_pin.report import plots
from aacmm_pin.report.calibration import KINDS, excluded_records, exclusions_in_words, files
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Figure,
    Heading,
    Notes,
    Paragraph,
    SceneView,
    Table,
    blank_axes,
    document_of,
)
from aacmm_pin.report.doubts import beside_threshold, doubts_in_words, labels_in_words
from aacmm_pin.report.next_measurements import next_measurements
from aacmm_pin.report.numbers import (
    capital,
    count,
    length,
    length_unit,
    lengths,
    p_equals,
    p_value,
    percent,
)
from aacmm_pin.report.plots.groups import held_out_parts, place_in_words
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.plots.residual_vectors import models, two_models

WAVES = 6
"""So many waves of a free curve are listed."""
LOOK_ALIKES = 3
LEAST_SHOWN, ALIKE = 1e-3, 0.9
"""Look-alikes of a cause that are listed: so many, of at least this probability or correlation."""
SETS, LEAST_SET = 6, 0.01
"""Sets of causes that are listed: so many, of at least this probability."""
ALTERNATIVES = 3
"""So many other sets of causes are named where the mass is on several."""
WORST = 5
"""Groups that the table names; the figure has all."""
COVARIATES = {"record": "the order of the records", "x": "place", "y": "place", "z": "place"}
"""What residuals may depend on, in words, where its name is none."""


@document_of.register
def diagnosis_document(
    result: Diagnosis, summary: dict[str, Any] | None = None, when: str = ""
) -> Document:
    """The diagnosis as a document.

    Args:
        result: the diagnosis.
        summary: for a page with files: what ``diagnose --json`` writes; its ``source`` is the name
            of the measurement file.
        when: date of the page (UTC).
    """
    planned = next_measurements(result) if summary is None else summary["next_measurements"]
    source = "" if summary is None else f" of {summary['source']}, {when} (UTC)"
    used = count(int(result.extended.used.sum()), "record")
    return Document(
        f"{result.model.arm.name}: diagnosis",
        [
            *_result(result),
            *_wrong(result),
            *_causes(result),
            *_on_the_arm(result),
            *_held_out(result),
            *_left(result),
            Heading("What to measure next"),
            Paragraph(f"{planned}.", finding=True, head="Next:"),
            Notes(result.notes),
            *([] if summary is None else _files(result, summary, when)),
        ],
        used + source,
    )


# Sentences ------------------------------------------------------------


def verdict_in_words(result: Diagnosis) -> str:
    """What the simulation lacks, that nothing was found, or that these records cannot tell; then
    what else is in doubt.
    """
    wrong = _wrong_in_words(result)
    if result.verdict == "unexplained":
        text = f"{_not_explained(result)}{f'; in addition, {wrong}' if result.findings else ''}"
    elif result.verdict == "inconclusive":
        text = _inconclusive(result, wrong)
    elif result.verdict == "ambiguous":
        text = _ambiguous(result, wrong)
    else:
        after = "recalibration and extension" if result.findings else "recalibration"
        text = f"{wrong}. After {after}, {_left_in_words(result)}"
    beside = doubts_in_words(result) if result.verdict in ("unexplained", "ambiguous") else ()
    doubts = "".join(f" {capital(doubt)}." for doubt in beside)
    return f"{_excluded_in_words(result)}{result.model.arm.name}: {text}.{doubts}"


def _ambiguous(result: Diagnosis, wrong: str) -> str:
    """The sets of causes that share the probability."""
    found = {finding.label for finding in result.findings}
    others = [
        (labels, share) for labels, share in result.alternatives.items() if set(labels) != found
    ]
    likely = [(labels, share) for labels, share in others if share >= THRESHOLDS.rival][
        :ALTERNATIVES
    ] or others[:1]
    named = [
        f"{labels_in_words(result, labels) or 'nothing'} (probability of this set "
        f"{probability(share)})"
        for labels, share in likely
    ]
    if not found:
        return f"these records do not settle what the simulation lacks: {listed(named, 'or')}"
    return f"{wrong}; instead it may lack {listed(named, 'or')}"


def _excluded_in_words(result: Diagnosis) -> str:
    """What stays unexplained for being excluded, where these records are no gross errors."""
    if result.verdict != "unexplained":
        return ""
    left = exclusions_of(result.extended)
    return f"{exclusions_in_words(left)} " if left.doubtful else ""


def _wrong_in_words(result: Diagnosis) -> str:
    """What the simulation lacks, or may lack, and which of its values are wrong: of the geometry,
    of the places of seats.
    """
    values = [f for f in result.findings if result.geometric(f) or corrects_seat(f.effect)]
    causes = [f for f in result.findings if f not in values]
    sound = [f for f in causes if f.borne_out and not (result.no_better or f.below_zero)]
    sure = [f for f in sound if f.probability >= THRESHOLDS.settled]
    doubtful = [f for f in causes if f not in sure]
    told = [
        ("lacks", [f for f in sure if f.was is None]),
        ("has values that are no longer right for", [f for f in sure if f.was]),
        ("may lack", [f for f in doubtful if f.was is None]),
        ("may have values that are no longer right for", [f for f in doubtful if f.was]),
    ]
    text = " and ".join(f"{how} {_named(some, result.model.arm)}" for how, some in told if some)
    text = f"the simulation {text}" if text else _none_found(result)
    if result.no_better:
        text += (
            f", but adding {'it' if len(causes) == 1 else 'them'} does not help to predict "
            "held-out records"
        )
    if not values:
        return text
    off = f"stated values are off by unusually much: {_named(values, result.model.arm)}"
    return (
        f"the simulation's {off}"
        if result.verdict == "unexplained" and not causes
        else f"{text}; its {off}"
    )


def _none_found(result: Diagnosis) -> str:
    """That no cause was found, and how probable it is that none acts."""
    return (
        "no cause was found that the simulation lacks (probability that none acts: "
        f"{probability(1.0 - result.more)})"
    )


def _named(findings: Sequence[Finding], arm: Arm) -> str:
    """Findings in a row, behind those in doubt their inclusion probability."""
    sure = several_in_words(
        [f.effect for f in findings if f.probability >= THRESHOLDS.settled], arm
    )
    doubtful = [f for f in findings if f.probability < THRESHOLDS.settled]
    named = [
        f"{in_words(f.effect, arm)} (inclusion probability {probability(f.probability)})"
        for f in doubtful
    ]
    return listed([sure, *named] if sure else named)


def _inconclusive(result: Diagnosis, wrong: str) -> str:
    if not result.converged:
        return f"the search did not converge ({result.converge_note}), so nothing can be concluded"
    if not result.extended.tells_noise:
        return "there are too few records to tell a cause from the noise"
    if result.extended.too_many_excluded:
        out, all_of = (
            int(result.extended.excluded.sum()),
            int((result.extended.used | result.extended.excluded).sum()),
        )
        return (
            f"{out} of {all_of} records do not agree with the others, too many for gross "
            f"errors; of the others: {wrong}"
        )
    doubts = "; ".join(doubts_in_words(result))
    if not result.findings:
        return f"no cause was found, but {doubts}"
    return f"these records suggest that {wrong}{f'; but {doubts}' if doubts else ''}"


def _not_explained(result: Diagnosis) -> str:
    left = result.rms["extended"]
    if result.noise > NO_SCATTER:
        more = f"the residuals stay {left / result.noise:.1f} times the noise"
    else:
        more = f"the residuals stay at {length(left)}, where the stated noise is none"
    turned = result.extended.noise.scatters.turn if result.extended.stated else 0.0
    if turned:
        more += f", and the orientations scatter by {turned / UM:.3g} µrad more than stated"
    left_over = result.unexplained
    names = [COVARIATES.get(name, name) for name in left_over.depends_on]
    depends = listed([*dict.fromkeys(names)])
    shared = left_over.shared_by_postures
    known = result.noise * np.hypot(1.0, 0.0 if shared is None else shared.times)
    larger = left > THRESHOLDS.much_more * known or turned > 0.0
    if not depends and left_over.has_background:
        more = (
            f"the residuals have structure of {_background(left_over)} that no single column "
            "explains"
        )
    elif depends:
        way = f"depend on {depends} in a way that none of the causes tried has"
        more = f"{more} and {way}" if larger else f"the residuals {way}"
    elif left_over.apart and not larger:
        more = ""
    return "; ".join(filter(None, [*map(str, left_over.apart), more]))


def _background(left: Unexplained) -> str:
    """The size of the background."""
    return next(
        f"{length(each.rms)} RMS" for each in left.discrepancy if each.covariate == BACKGROUND
    )


def alias_in_words(alias: Alias, arm: Arm) -> str:
    """A look-alike: a cause and where it sits, or a covariate."""
    return (
        f"dependence on {alias.label}" if alias.effect is None else name_in_words(alias.effect, arm)
    )


def line_to_remember(result: Diagnosis) -> str:
    """Sizes of residuals by the three models, the noise, and the gain on held-out records."""
    simulated, recalibrated, extended, noise = lengths(result.rms.values())
    alone = "noise alone" if result.extended.stated else "scatter"
    sizes = (
        f"RMS {simulated} simulated → {recalibrated} recalibrated → {extended} extended; "
        f"{alone} {noise}."
    )
    return f"{sizes} {gain_in_words(result)}"


def gain_in_words(result: Diagnosis) -> str:
    """What the extended model is worth on held-out records."""
    held = result.held_out
    if held is None:
        return "Nothing was held out, so the gain on other records is not known."
    if np.array_equal(held.extended, held.recalibrated, equal_nan=True):
        return (
            "The extended and the recalibrated arm are the same, so there is no gain on "
            "held-out records."
        )
    low, high = held.interval
    nothing = "" if held.beyond_doubt or high < -THRESHOLDS.least_gain else ", not significant"
    counted = f" {_of_extended(held)}".rstrip()
    if result.findings and result.extended.too_many_excluded:
        counted += " It need not hold at new postures: the extended arm excludes too many records."
    return (
        f"Gain of the extended over the recalibrated arm on held-out {KINDS[held.kind]}: "
        f"{percent(held.gain)} "
        f"(95 %: {100 * low:z.0f} to {percent(high)}){nothing}.{counted}"
    )


def _left_in_words(result: Diagnosis) -> str:
    """What is left of the residuals."""
    if result.extended.scatters:
        scatter = f"the residuals scatter by {length(result.extended.unmodelled)} per coordinate"
        return (
            f"{scatter}, which counts as noise"
            if not result.extended.stated
            else f"{scatter} beyond the stated noise"
        )
    return "the arm agrees with the records to within their noise"


@document_of.register
def unexplained_document(left: Unexplained) -> Document:
    """What depends on a column in a way that no cause has."""
    return Document("Unexplained", _structure(left))


def unexplained_in_words(left: Unexplained) -> str:
    """What structure is left, or that none is."""
    p, covariates = p_equals(left.p_value), [*left.acts_on]
    branches = "".join(
        f"{capital(each)}. " for each in (*map(_with_its_chance, left.apart), *_excluded(left))
    )
    on_held_out = "of what the causes leave on held-out records"
    worth = (
        ""
        if left.gain is None
        else f" A smooth correction removes {percent(left.gain)} {on_held_out}."
    )
    if not covariates and left.has_background:
        return (
            f"{branches}Structure of {_background(left)} is left that no single column "
            f"explains.{worth}"
        )
    if not covariates:
        if left.groups:
            return f"{branches}Groups of records do not agree with the others ({p})."
        if left.excluded is not None:
            return branches.strip()
        what = "Structure over a column is" if left.left else "No structure over a column is"
        return f"{branches}{what} left beyond chance ({beside_threshold(left)})."
    return (
        f"{branches}The residuals depend on {listed(covariates)} ({p}) in a way that no cause "
        f"of the library has.{worth}"
    )


def _saved_in_words(result: Diagnosis) -> str:
    """What the extended arm has of what no cause explains."""
    parts = [each.covariate for each in result.unexplained.discrepancy]
    if not parts:
        return ""
    said, lost = [], result.not_saved
    if saved := listed([name for name in parts if name not in lost]):
        there = any(isinstance(effect, Discrepancy) for effect in result.model.effects)
        has = (
            "has this discrepancy too"
            if there
            else "does not have this; --with-discrepancy saves it"
        )
        said.append(f"The extended arm {has}: {saved}.")
    if lost:
        said.append(
            f"No arm file can have the discrepancy over {listed(lost)}, which is not known of new "
            "readings."
        )
    return " ".join(said)


def _with_its_chance(one: Branches | ScatteredReadings | SharedError) -> str:
    """A statement with the number that it rests on."""
    rests_on = (
        f"log likelihood ratio {one.log_ratio:.1f}"
        if isinstance(one, Branches)
        else p_equals(one.p_value)
    )
    return f"{one} ({rests_on})"


def _excluded(left: Unexplained) -> list[str]:
    """What the excluded records share."""
    shared = left.excluded
    if shared is None:
        return []
    if shared.excluded == 1:
        return [f"records round an excluded one have {shared.where}"]
    how_many = "all" if shared.excluded == shared.of else f"{shared.excluded} of"
    return [f"{how_many} {shared.of} excluded records have {shared.where}"]


# Tables ------------------------------------------------------------


def motion_of(result: Diagnosis, effect: Effect, state: State | None = None) -> float:
    """RMS by which a cause moves the tip, or the stated place, over the used records [m];
    ``state``: extended arm.
    """
    moved = sensitivity(effect, state or state_of(result.extended)) @ np.array(effect.values)
    return rms(np.linalg.norm(moved[result.extended.used], axis=1))


def ranking(result: Diagnosis) -> pd.DataFrame:
    """The causes, strongest first: cause, value ± U, size at the tip, probability, p, retained,
    label.
    """
    state = state_of(result.extended)
    rows = [
        {
            "cause": in_words(f.effect, result.model.arm),
            "value ± U (k = 2)": values_in_words(f.effect, f.parameters, f.slides),
            "at the tip_mm": motion_of(result, f.effect, state) / MM,
            "probability": probability(f.probability),
            "p": p_value(f.p_value),
            "retained": percent(f.retained_fraction),
            "label": f.label,
        }
        for f in result.findings
    ]
    return Table(pd.DataFrame(rows)).cells()


def alternatives(result: Diagnosis) -> pd.DataFrame:
    """The sets of causes, most probable first: causes, probability; last all others together."""
    likely = [
        (labels, share) for labels, share in result.alternatives.items() if share >= LEAST_SET
    ][:SETS]
    rows = [
        (labels_in_words(result, labels) or "none", probability(share)) for labels, share in likely
    ]
    others = len(result.alternatives) - len(likely)
    rest = 1.0 - sum(share for _, share in likely)
    if others:
        rows.append((count(others, "other set"), probability(max(rest, 0.0))))
    return pd.DataFrame(rows, columns=["causes", "probability"])


def look_alikes(result: Diagnosis) -> pd.DataFrame:
    """Aliases of each cause in these records: cause, alias, correlation r, probability of the alias
    alone, label.
    """
    shown = [
        (finding, alias)
        for finding in result.findings
        for alias in finding.aliases[:LOOK_ALIKES]
        if alias.probability > LEAST_SHOWN or abs(alias.correlation) > ALIKE
    ]
    rows = [
        {
            "cause": in_words(finding.effect, result.model.arm),
            "alias": alias_in_words(alias, result.model.arm),
            "r": alias.correlation,
            "probability": probability(alias.probability),
            "label": alias.label,
        }
        for finding, alias in shown
    ]
    return pd.DataFrame(rows)


def discrepancy_table(left: Unexplained) -> pd.DataFrame:
    """What no cause explains: covariate, size at the tip, u, probability."""
    rows = [
        {
            "depends on": each.covariate,
            "rms_mm": each.rms / MM,
            "u_mm": each.u / MM,
            "p": probability(each.probability),
        }
        for each in left.discrepancy
    ]
    return pd.DataFrame(rows).rename(columns={"p": "probability"})


def residuals_table(result: Diagnosis) -> pd.DataFrame:
    """One row a record: line of the file, labels, tip minus target by each model and held out [mm],
    whether it was used.
    """
    table = residuals_by_record(models(result))
    if (held := result.held_out) is not None:
        names = ("recalibrated", "extended")
        table = table.assign(
            part=held.part, **{f"held_out_{name}_mm": getattr(held, name) / MM for name in names}
        )
    return table.assign(used=result.extended.used)


# Sections ------------------------------------------------------------


def _result(result: Diagnosis) -> list[Block]:
    stated = (
        ""
        if result.extended.stated
        else " Not all noise was stated; the rest is the scatter that the extended arm leaves."
    )
    seats = (
        " An error of a seat's stated place hardly shows here, where residuals are taken from the "
        "place that its records "
        "have in common, nor in the gain."
        if any(corrects_seat(f.effect) for f in result.findings)
        else ""
    )
    return [
        Heading("Result"),
        Paragraph(verdict_in_words(result), finding=True, head=f"{capital(result.verdict)}."),
        Paragraph(line_to_remember(result), finding=True),
        rms_figure(result),
        Paragraph(f"{stated}{seats}".strip(), detail=True),
    ]


def rms_figure(result: Diagnosis) -> Figure:
    """Sizes of the residuals by the three models."""
    return Figure(
        lambda: plots.plot_rms(result, blank_axes(6.8, 2.0)),
        "RMS of the residuals by the three models",
        "Residuals of the records, set-up fitted: by the arm as it was simulated; with its "
        "geometry recalibrated; and "
        "extended by the causes found. Dashed: what the noise of readings and references gives.",
    )


def _wrong(result: Diagnosis) -> list[Block]:
    title, table = Heading("Where the simulation is wrong"), result.residual_groups
    if table.empty:
        return [title, Paragraph("There are too few records to compare groups.", detail=True)]
    height = 0.5 - 2.2 * (-table["by"].nunique() // 3)
    predicted, beside, line = (
        "predicted",
        "what the stated uncertainties and the noise predict",
        "dashed",
    )
    if table["predicted_mm"].equals(table["noise_mm"]):
        predicted, beside, line = (
            "noise",
            "the noise, as no uncertainty is stated that would predict more",
            "dotted",
        )
    worst = _worst(result, predicted)
    return [
        title,
        Figure(
            lambda: plots.plot_groups(result, blank_axes(9.3, height)),
            "RMS of the residuals by joint range, time, temperature and seat, by the three models",
            "RMS of the residuals in groups of two or more records. Black: the simulation, "
            f"beside the {line} line: "
            f"{beside}. Grey and blue: recalibrated and extended, to be compared with the dotted "
            "line, the noise alone. "
            "What stays above it is not explained.",
        ),
        Table(
            worst,
            f"Where the simulation is wrong most, beside {beside} (RMS)",
            {f"times {predicted}": ".2f"},
            most=WORST,
        ),
        Paragraph(
            ""
            if len(worst)
            else f"The simulation is in no group of records more wrong than {beside}."
        ),
    ]


def _worst(result: Diagnosis, predicted: str) -> pd.DataFrame:
    """Groups that are farther off than predicted, the worst first, in the unit of the RMS
    of all.
    """
    table = result.residual_groups
    worse = table[table["times_predicted"] > 1.0]
    unit, scale = length_unit(max(result.rms.values()))
    found = pd.DataFrame(
        {"where": list(map(place_in_words, worse["by"], worse["group"]))}, index=worse.index
    )
    found["records"] = worse["records"]
    heads = {"simulation": "simulation", "predicted": predicted, "extended": "extended"}
    for name, head in heads.items():
        found[f"{head} [{unit}]"] = worse[f"{name}_mm"] * (MM / scale)
    found[f"times {predicted}"] = worse["times_predicted"]
    return found


def _causes(result: Diagnosis) -> list[Block]:
    waves = {
        in_words(f.effect, result.model.arm): strongest_waves(f.effect) or []
        for f in result.findings
    }
    curves = [
        f"{capital(words)}, waves per turn: "
        + ", ".join(f"{n:.3g} ({size / UM:.1f} µrad)" for n, size in found[:WAVES])
        for words, found in waves.items()
        if found
    ]
    return [
        Heading("The causes"),
        Paragraph(
            "" if result.findings else "No cause is more probable than not, and none was added.",
            detail=True,
        ),
        Table(
            ranking(result),
            "Causes in the extended model",
            explained="Strongest first; geometric values last. At the tip: RMS over all records. "
            "Probability: that the "
            "cause acts. p: chance that the best of all causes looks as good when none is there. "
            "Retained: part of the "
            "effect that a recalibration leaves.",
        ),
        Bullets(curves),
        *causes_drawn(result),
        Table(
            alternatives(result),
            "Sets of causes that may act, with their probabilities",
            explained="The probabilities of all sets add up to one; those of less than 1 % are "
            "added up.",
        ),
        Bullets(
            [
                f"These records do not distinguish {labels_in_words(result, each)}."
                for each in result.cannot_tell_apart
            ]
        ),
        Table(
            look_alikes(result),
            "Aliases: causes with a similar effect in these records",
            {"r": ".2f"},
            explained="r: correlation of the two in these records, geometry refitted. "
            "Probability: that the alias acts and "
            "the cause does not.",
        ),
    ]


def causes_drawn(result: Diagnosis) -> list[Block]:
    """A figure of each cause that depends on something, and one of all geometric values."""
    state = state_of(result.extended)
    blocks: list[Block] = []
    for finding in result.findings:
        effect = finding.effect
        if result.geometric(finding) or (is_constant(effect, state) and not corrects_seat(effect)):
            continue
        draw = lambda f=finding: plots.plot_cause(result, f, blank_axes(7.4, 4.0))  # noqa: E731
        words = capital(in_words(effect, result.model.arm))
        how = (
            f"{words}. Dots: records, everything else as fitted. Circles: their means with u. "
            "Line: the cause as fitted."
        )
        blocks.append(Figure(draw, f"{words}, from the records", how))
    if number := sum(result.geometric(f) for f in result.findings):
        blocks.append(
            Figure(
                lambda: plots.plot_geometry(result, blank_axes(7.4, 1.4 + 0.45 * number)),
                "Geometric values beyond their stated uncertainty",
                "Geometric values that moved farther than their stated uncertainties allow.",
            )
        )
    return blocks


def _on_the_arm(result: Diagnosis) -> list[Block]:
    from aacmm_pin.report.scenes import residual_scene  # loads meshcat

    left, right = two_models(result)
    return [
        Heading("Residuals on the arm"),
        Figure(
            lambda: plots.plot_residual_views(result, blank_axes(8.6, 8.0)),
            f"Residual vectors on a drawing of the arm, {left} and {right}",
            f"Residuals from each stated place towards the tip: left {left}, right {right}; above "
            "in plan, below from the "
            "side; all magnified alike. Grey: the arm in some of its postures. Neighbours that "
            "point the same way show what "
            "a model lacks.",
        ),
        SceneView(
            lambda: residual_scene(result, left),
            f"The residuals of the {left} arm to turn: drag to look from elsewhere; the slider "
            "goes from the largest to the "
            "smallest, with the arm in its posture.",
        ),
    ]


def _held_out(result: Diagnosis) -> list[Block]:
    held, title = result.held_out, Heading("Held-out validation")
    if held is None:
        return [title, Paragraph(gain_in_words(result), detail=True)]
    table = held_out_parts(result)[["part", "records", "gain", "chosen"]].rename(
        columns={"part": "left out"}
    )
    table["chosen without it"] = [
        labels_in_words(result, chosen) or "nothing" for chosen in table.pop("chosen")
    ]
    seats = (
        " A seat is judged by its stated coordinates with all their noise, which makes the "
        "gain less." * (held.kind == "seats")
    )
    return [
        title,
        Figure(
            lambda: plots.plot_held_out(result, blank_axes(7.2, 3.4)),
            "RMS of each part that was left out, recalibrated and extended",
            f"{capital(KINDS[held.kind])} were left out in turn, of the choice of causes as well, "
            "and predicted by the "
            "other records: RMS of each. Gain = 1 - RMS extended / RMS recalibrated. "
            f"{_counted(held)}{seats}",
        ),
        Table(table, "What was chosen without each part", {"gain": percent}, detail=True),
    ]


def _counted(held: Gain) -> str:
    """Which excluded records count in the gain."""
    out = f"Not counted: {count(held.gross_errors, 'record')} that both arms exclude." * bool(
        held.gross_errors
    )
    return f"{_of_extended(held)} {out}".strip()


def _of_extended(held: Gain) -> str:
    """How many records count in the gain though the extended arm excludes them."""
    return (
        f"Counted too: {count(held.excluded, 'record')} that only the extended arm excludes."
        * bool(held.excluded)
    )


def _left(result: Diagnosis) -> list[Block]:
    left = result.unexplained
    shapes = [
        Figure(
            lambda name=name: plots.plot_unexplained(result, name, blank_axes(7.4, 4.0)),  # type: ignore[misc]
            f"Structure over {name} without a known cause",
            f"Over {name}: {left.acts_on[name]}. Dots: the records.",
        )
        for name in left.shapes
    ]
    saved = Paragraph(_saved_in_words(result))
    return [
        Heading("What no cause explains"),
        *_structure(left),
        saved,
        *shapes,
        *excluded_records(result.excluded),
    ]


def _structure(left: Unexplained) -> list[Block]:
    groups = pd.DataFrame([asdict(group) for group in left.groups])
    return [
        Paragraph(unexplained_in_words(left), finding=left.structure),
        Table(
            discrepancy_table(left),
            "The discrepancy at the tip",
            explained="RMS of what recalibration leaves of it, with its standard uncertainty, and "
            "the probability that it "
            "is there.",
        ),
        Bullets([f"Over {name}: {way}." for name, way in left.acts_on.items()]),
        Table(
            groups,
            "Groups that do not agree with the other records, and how many times as far off they "
            "are; check their set-up",
            {"times": ".1f", "p_value": p_value},
            {"name": "group", "p_value": "p"},
        ),
    ]


def _files(result: Diagnosis, summary: dict[str, Any], when: str) -> list[Block]:
    note = f"Extended by aacmm-pin diagnose on {when} (UTC) from {summary['source']}: {result}"
    return files(
        summary, residuals_table(result), result.model, ("diagnosis.json", "extended.toml"), note
    )
