"""A diagnosis as a document: verdict, where the simulation is wrong, causes, gain on held-out records, what is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM, UM
from aacmm_pin.arm.file import arm_text
from aacmm_pin.calibration.cross_validation import rms
from aacmm_pin.diagnosis import Diagnosis, Finding, OddGroup
from aacmm_pin.diagnosis.cross_validation import Gain
from aacmm_pin.diagnosis.result import SETTLED
from aacmm_pin.diagnosis.significance import Alias
from aacmm_pin.diagnosis.unexplained import Unexplained
from aacmm_pin.effects import Effect, State
from aacmm_pin.effects.labels import in_words, listed, name_in_words, probability, several_in_words, values_in_words
from aacmm_pin.report import plots
from aacmm_pin.report.calibration import KINDS, excluded_records, files
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Details,
    Document,
    Download,
    Figure,
    Heading,
    Notes,
    Paragraph,
    SceneView,
    Table,
    blank_axes,
    document_of,
)
from aacmm_pin.report.numbers import (
    capital,
    count,
    in_one_unit,
    length,
    lengths,
    p_equals,
    p_value,
    percent,
)
from aacmm_pin.report.plots.groups import held_out_parts, place_in_words, residuals_by_group
from aacmm_pin.report.plots.parameter_changes import geometric
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.plots.residual_vectors import models, two_models

CHANCE = 0.01
"""Structure with less chance than this is not nothing."""
BEYOND = 1.3
"""So many times what was predicted is worth a reader's attention."""
LIKELY = 0.5
"""A cause less probable than this is not called found."""
LEFT_OUT_SEATS = (
    "A seat left out is judged by its stated coordinates with all their noise, so this gain is less than that in the "
    "records that were used."
)
"""Why the gain on seats looks small."""
WAVES = 6
"""So many waves of a free curve are listed."""
LOOK_ALIKES = 3
LEAST_SHOWN, ALIKE = 1e-3, 0.9
"""Look-alikes of a cause that are listed: so many, of at least this probability or correlation."""
WORST, WORST_ON_PAGE = 3, 8
"""Groups that the tables name; the figure has all."""
PREDICTED = {True: "that the arm's stated uncertainties and the noise predict", False: "that the noise alone gives"}


@document_of.register
def diagnosis_document(result: Diagnosis, summary: dict[str, Any] | None = None, when: str = "") -> Document:
    """The diagnosis as a document.

    Args:
        result: the diagnosis.
        summary: for a page with files: what ``diagnose --json`` writes; its ``source`` is the name of the measurement file.
        when: date of the page (UTC).
    """
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
            Paragraph(f"{result.next_measurements}.", finding=True, head="Next:"),
            Notes(result.notes),
            *([] if summary is None else _files(result, summary, when)),
        ],
        used + source,
    )


# Sentences ---------------------------------------------------------------------------------------------------------------


def verdict_in_words(result: Diagnosis) -> str:
    """One sentence: what the simulation lacks, that it lacks nothing, or that these records cannot tell."""
    name, left, wrong = result.model.arm.name, _left_in_words(result), _what_is_wrong(result.findings, result)
    if result.verdict == "unexplained":
        wrong = _what_is_wrong([f for f in result.findings if f.probability >= SETTLED], result)
        return f"{name}: {_not_explained(result)}{f' In addition, {wrong}.' if wrong else ''}"
    if result.verdict == "inconclusive":
        return f"{name}: {_inconclusive(result, wrong)}"
    if result.verdict == "no-discrepancy":
        return f"{name}: no cause is missing in the simulation. With the arm recalibrated, {left}."
    if result.verdict == "ambiguous":
        rivals = "; ".join(_doubt(f) for f in result.findings if f.probability < SETTLED)
        which = "which" if len(result.findings) == 1 else "all of them"
        return f"{name}: {wrong}, but these records do not settle {which}: {rivals}."
    none = "" if _own_causes(result.findings, result) else "no cause is missing in the simulation, but "
    return f"{name}: {none}{wrong}. With {'it' if len(result.findings) == 1 else 'these'}, {left}."


def _inconclusive(result: Diagnosis, wrong: str) -> str:
    left = p_equals(result.unexplained.p_value)
    if not result.converged:
        return f"the search did not converge ({result.converge_note}), so nothing can be concluded."
    if not result.extended.tells_noise:
        return "there are too few records to tell a cause from the noise."
    if not result.findings:
        seen, of = result.visible
        if seen > of / 2:
            return f"no cause was found, but something may be left ({left})."
        return f"too few records: of {count(of, 'cause')} of usual size they would show {seen}, and show none."
    doubtful = [f.effect for f in result.findings if not f.borne_out]
    if not doubtful:
        return f"these records suggest that {wrong}, but something else may be left ({left})."
    return f"these records suggest that {wrong}, but held-out records do not confirm {several_in_words(doubtful)}."


def _not_explained(result: Diagnosis) -> str:
    open_ = result.unexplained
    if not open_.depends_on:
        more = f"{result.rms['extended'] / result.noise:.1f} times the stated noise"
        return f"the residuals stay {more}, and depend on no column of the file."
    odd = [group.name for group in open_.groups if group.name in open_.depends_on]
    if odd:
        return f"{listed(odd)} does not agree with the other records."
    return f"the residuals depend on {listed(open_.depends_on)}, and no known cause has this shape."


def _own_causes(findings: Sequence[Finding], result: Diagnosis) -> list[Effect]:
    """Findings that are causes of their own, and no value that the simulation has but has wrong."""
    return [f.effect for f in findings if not (geometric(result, f) or f.effect.corrects_seat)]


def _what_is_wrong(findings: Sequence[Finding], result: Diagnosis) -> str:
    """What the simulation lacks, and which of its values are wrong: of the geometry, of the places of seats."""
    likely, unlikely = _parted(findings)
    causes = _own_causes(likely, result)
    moved = [f.effect for f in likely if geometric(result, f)]
    seats = sorted(str(f.effect.place) for f in likely if f.effect.corrects_seat)
    found = []
    if causes:
        number = "one cause" if len(causes) == 1 else f"{len(causes)} causes"
        found.append(f"the simulation lacks {number}, {several_in_words(causes)}")
    if moved:
        found.append(f"its geometry is off by unusually much for what was stated: {several_in_words(moved)}")
    if seats:
        one = len(seats) == 1
        found.append(f"the stated place{'' if one else 's'} of {listed(seats)} {'is' if one else 'are'} wrong")
    if unlikely:
        less = several_in_words([f.effect for f in unlikely])
        found.append(f"less probably {less}" if found else f"the simulation may lack {less}")
    return ", and ".join(found)


def _parted(findings: Sequence[Finding]) -> tuple[list[Finding], list[Finding]]:
    """Findings that may be called found, and those that are less probable than not."""
    return [f for f in findings if f.probability >= LIKELY], [f for f in findings if f.probability < LIKELY]


def _doubt(finding: Finding) -> str:
    others = [f"{alias_in_words(a)} {probability(a.probability)}" for a in finding.aliases if a.probability >= 0.01]
    return listed([f"{in_words(finding.effect)} has probability {probability(finding.probability)}", *others])


def alias_in_words(alias: Alias) -> str:
    """A look-alike: a cause and where it sits, or a covariate."""
    return f"dependence on {alias.label}" if alias.effect is None else name_in_words(alias.effect)


def labels_in_words(result: Diagnosis, labels: Sequence[str], together: bool = True) -> str:
    """Causes and covariates that labels of the result name, in a row; those of one kind together, where asked."""
    effects = [effect for label in labels if (effect := result.cause(label)) is not None]
    others = [f"dependence on {label}" for label in labels if result.cause(label) is None]
    names = [several_in_words(effects, inner=False)] if together and effects else list(map(name_in_words, effects))
    return listed([*names, *others])


def line_to_remember(result: Diagnosis) -> str:
    """Sizes of residuals by the three models, the noise, and the gain on held-out records."""
    sizes = dict(zip(result.rms, lengths(result.rms.values()), strict=True))
    text = (
        f"RMS {sizes['simulation']} simulated → {sizes['recalibrated']} recalibrated → {sizes['extended']} extended; "
        f"noise alone {sizes['noise']}."
    )
    return text if result.held_out is None else f"{text} {gain_in_words(result)}"


def gain_in_words(result: Diagnosis) -> str:
    """What the extended model is worth on held-out records."""
    held = result.held_out
    if held is None:
        return "Nothing was held out, so the gain on other records is not known."
    low, high = held.interval
    where, interval = f"On held-out {KINDS[held.kind]}", f"(95 %: {100 * low:z.0f} to {percent(high)})"
    if not result.findings:
        return f"{where} there is nothing to gain beyond recalibration."
    if round(100 * low) <= 0 <= round(100 * high):
        gain = f"{percent(held.gain)} {interval}"
        return f"{where} the extended arm is not significantly better than the recalibrated one: {gain}."
    less = f"{percent(abs(held.gain))} {'less' if low > 0 else 'more'}"
    return f"{where} the residuals of the extended arm are {less} than those of the recalibrated one {interval}."


def _left_in_words(result: Diagnosis) -> str:
    """What is left of the residuals."""
    fit = result.extended
    if not fit.stated and fit.scatters:
        return (
            f"the residuals scatter by {length(fit.unmodelled)} per coordinate beyond the stated noise, which is incomplete"
        )
    if fit.scatters:
        return f"the residuals are still larger than the stated noise, by {length(fit.unmodelled)} per coordinate"
    return "the arm agrees with the records to within their noise"


def unexplained_in_words(result: Diagnosis) -> str:
    """What structure is left, or that none is."""
    open_, p, left = result.unexplained, p_equals(result.unexplained.p_value), capital(_left_in_words(result))
    covariates = [name for name in open_.depends_on if name not in {group.name for group in open_.groups}]
    if covariates:
        return (
            f"The residuals depend on {listed(covariates)} ({p}) in a way that no cause of the library has. The smooth "
            f"correction only describes this; it is not part of the extended arm.{_worth(open_)}"
        )
    if open_.groups:
        return f"The residuals depend on no column of the file, but not all groups of records agree. {left}."
    if open_.p_value < CHANCE:
        return f"Structure is left beyond chance ({p}), but over no single column. {left}."
    return f"Nothing that depends on a joint's angle, time or any other column is left beyond chance ({p}). {left}."


def _worth(open_: Unexplained) -> str:
    if open_.gain is None:
        return ""
    return f" On held-out records it removes {percent(open_.gain)} of what the causes leave."


def group_in_words(group: OddGroup) -> str:
    """That a group does not agree with the other records, by how much, and what to do."""
    return (
        f"The {count(group.records, 'record')} of {group.name} do not agree with the others: their residuals, predicted by "
        f"the others, are {group.times:.1f} times as large ({p_equals(group.p_value)}). Check the set-up."
    )


def curves_in_words(result: Diagnosis) -> list[str]:
    """The strongest waves of each free curve that was found."""
    return [
        f"{capital(in_words(f.effect))}, waves per turn: "
        + ", ".join(f"{order:.3g} ({size / UM:.1f} µrad)" for order, size in waves[:WAVES])
        for f in result.findings
        if (waves := f.effect.spectrum()) is not None
    ]


# Tables ------------------------------------------------------------------------------------------------------------------


def motion_of(result: Diagnosis, effect: Effect, state: State | None = None) -> float:
    """RMS by which a cause moves the tip, or the stated place, over the used records [m]; ``state``: extended arm."""
    moved = effect.sensitivity(state or state_of(result.extended)) @ np.array(effect.values)
    return rms(np.linalg.norm(moved[result.extended.used], axis=1))


def ranking(result: Diagnosis, findings: Sequence[Finding] | None = None) -> pd.DataFrame:
    """The causes, or some, strongest first: cause, label, value ± U, size at the tip, probability, p, retained."""
    chosen = result.findings if findings is None else findings
    if not chosen:
        return pd.DataFrame()
    state = state_of(result.extended)
    rows = [
        {
            "cause": in_words(f.effect),
            "label": f.label,
            "value ± U (k = 2)": values_in_words(f.effect, f.parameters),
            "at the tip": motion_of(result, f.effect, state),
            "probability": probability(f.probability),
            "p": p_value(f.p_value),
            "retained": percent(f.retained_fraction),
        }
        for f in chosen
    ]
    frame, formats = in_one_unit(pd.DataFrame(rows), ["at the tip"])
    return Table(frame, formats=formats).cells()


def look_alikes(result: Diagnosis) -> pd.DataFrame:
    """What looks like each cause in these records: cause, looks like, label, correlation r, probability in its place."""
    return pd.DataFrame(
        [
            {"cause": in_words(f.effect)} | _alike(alias)
            for f in result.findings
            for alias in f.aliases[:LOOK_ALIKES]
            if alias.probability > LEAST_SHOWN or abs(alias.correlation) > ALIKE
        ]
    )


def _alike(alias: Alias) -> dict[str, object]:
    words, odds = alias_in_words(alias), probability(alias.probability)
    return {"looks like": words, "label": alias.label, "r": alias.correlation, "probability": odds}


def residuals_table(result: Diagnosis) -> pd.DataFrame:
    """One row a record: line of the file, labels, tip minus target by each model and held out [mm], whether it was used."""
    records = result.extended.problem.measurements
    table: dict[str, Any] = {"row": records.row}
    for holder, names in ((records, ("record", "operator")), (records.conditions, ("seat", "marker", "session"))):
        table |= {name: getattr(holder, name) for name in names if getattr(holder, name) is not None}
    for name, fit in models(result).items():
        deviation = fit.solution.system.deviation / MM
        table |= {f"{axis}_{name}_mm": deviation[:, k] for k, axis in enumerate("xyz")}
        table[f"{name}_mm"] = np.linalg.norm(deviation, axis=1)
    if (held := result.held_out) is not None:
        table |= {"part": held.part} | {f"held_out_{n}_mm": getattr(held, n) / MM for n in ("recalibrated", "extended")}
    return pd.DataFrame(table | {"used": result.extended.used})


# Sections ----------------------------------------------------------------------------------------------------------------


def _result(result: Diagnosis) -> list[Block]:
    noise = (
        ""
        if result.extended.stated
        else "The noise was not stated in full; it is estimated with the scatter that the extended arm leaves."
    )
    seats = (
        "These residuals are taken from the place that the records of a seat have in common, so they hardly show an error "
        "of its stated place; nor does the gain, because a seat that is left out whole says nothing of its own place. The "
        "sections on causes and on residuals in space show it."
        if any(f.effect.corrects_seat for f in result.findings)
        else ""
    )
    return [
        Heading("Result"),
        Paragraph(verdict_in_words(result), finding=True, head=f"{capital(result.verdict)}."),
        Paragraph(line_to_remember(result), finding=True),
        Figure(
            lambda: plots.plot_rms(result, blank_axes(6.8, 2.0)),
            "RMS of the residuals by the three models",
            "Residuals of the records, set-up fitted: by the arm as it was simulated; with its geometry recalibrated; and "
            "extended by the causes found. The dashed line is what the noise of readings and references gives.",
        ),
        Paragraph(noise, detail=True),
        Paragraph(seats, detail=True),
    ]


def _wrong(result: Diagnosis) -> list[Block]:
    table = residuals_by_group(result)
    if table.empty:
        return [
            Heading("Where the simulation is wrong"),
            Paragraph("There are too few records to compare groups.", detail=True),
        ]
    table["where"] = [place_in_words(by, group) for by, group in zip(table["by"], table["group"], strict=True)]
    table = table.sort_values("times_predicted", ascending=False, ignore_index=True)
    first, columns = table.iloc[0], {"simulation": "simulated", "predicted": "predicted", "recalibrated": "recalibrated"}
    columns |= {"extended": "extended", "noise": "noise"}
    shown = pd.DataFrame({"where": table["where"], "records": table["records"]})
    shown = shown.assign(**{head: table[f"{name}_mm"] * MM for name, head in columns.items()})
    shown.insert(4, "times predicted", table["times_predicted"])
    shown, formats = in_one_unit(shown, list(columns.values()))
    stated = PREDICTED[bool(result.before.problem.model.covariance().any())]
    after, last = (
        f"up to {(table[f'{name}_mm'] / table['noise_mm']).max():.1f} times the noise"
        for name in ("recalibrated", "extended")
    )
    simulated, predicted = lengths(first[["simulation_mm", "predicted_mm"]] * MM)
    text = (
        f"Compared with what is predicted, the residuals of the simulation are largest at {first['where']}: "
        f"{simulated} RMS, {first['times_predicted']:.1f} times the {predicted} {stated}. After recalibration residuals are "
        f"{after}; extended, {last}."
    )
    far = first["times_predicted"] > BEYOND
    if not far:
        text = f"Nowhere are the residuals much larger than the arm's stated uncertainties allow. {text}"
    return [
        Heading("Where the simulation is wrong"),
        Paragraph(text, finding=bool(far), detail=True),
        Figure(
            lambda: plots.plot_groups(result, blank_axes(9.3, 0.5 - 2.2 * (-table["by"].nunique() // 3))),
            "RMS of the residuals by joint range, time, temperature and seat, by the three models",
            "RMS of the residuals in groups of records. Black: the simulation, to be compared with the dashed line, what "
            "its stated uncertainties and the noise predict. Grey and blue: recalibrated and extended, to be compared with "
            "the dotted line, the noise alone. What stays above it is not explained.",
        ),
        Table(
            shown,
            "Where the simulation is wrong most, beside what its stated uncertainties predict (RMS)",
            formats | {"times predicted": ".1f"},
            most=WORST,
            most_on_page=WORST_ON_PAGE,
            on_page=[name for name in formats if name.startswith(("extended", "recalibrated", "noise"))],
        ),
    ]


def _causes(result: Diagnosis) -> list[Block]:
    likely, unlikely = _parted(result.findings)
    explained = (
        "Strongest first; geometric values last. At the tip: RMS over all records. Probability: of this cause against its "
        "look-alikes and none. p: chance that the best of all causes looks as good when none is there. Retained: part of "
        "the effect that a recalibration leaves."
    )
    blocks: list[Block] = [
        Heading("The causes"),
        *([] if result.findings else [Paragraph("No cause was found, and none was added to the model.", detail=True)]),
        Table(ranking(result, likely), "Causes found", explained=explained, on_page=["p"], in_short=["label"]),
        Table(
            ranking(result, unlikely),
            "In the extended model, but less probable than not",
            explained="" if likely else explained,
            on_page=["p"],
            in_short=["label"],
        ),
        Bullets(curves_in_words(result)),
        *_causes_drawn(result),
        Table(
            look_alikes(result),
            "What looks like them, with the probability of the other cause in its place",
            {"r": ".2f"},
            explained="r: correlation of the two in these records, geometry refitted. Two with r near 1 are "
            "hard to tell apart. The probability says how far these records tell them apart; it also weighs the number of "
            "values and their usual sizes.",
            in_short=["label"],
        ),
    ]
    found = {f.label for f in result.findings}
    groups = sorted(result.cannot_tell_apart, key=lambda group: not found & set(group))
    words = [f"{capital(labels_in_words(result, group, together=False))}." for group in groups]
    noun = "group" if any(len(group) > 2 for group in groups) else "pair"
    named = [f.label for f in result.findings if any(f.label in group for group in groups)]
    if named:
        which = capital(labels_in_words(result, named, together=False))
        words.append(f"{which}: in such a {noun}, preferred for the usual size, hardly for the shape.")
    title = f"{count(len(groups), noun)} of causes that these records cannot tell apart at their usual size"
    return [*blocks, Details(title, [Bullets(words)] if words else [])]


def _causes_drawn(result: Diagnosis) -> list[Block]:
    """A figure of each cause, or a sentence where it displaces every record alike."""
    state = state_of(result.extended)
    blocks: list[Block] = []
    for finding in result.findings:
        effect, words = finding.effect, capital(in_words(finding.effect))
        if geometric(result, finding):
            continue
        what = "stated place" if effect.of_reference else "tip"
        size = length(motion_of(result, effect, state))
        text = f"{words}: {values_in_words(finding.effect, finding.parameters)}. It moves the {what} by {size} (RMS)."
        if finding.probability < LIKELY:
            text += f" It is less probable than not (probability {probability(finding.probability)})."
        if "time_s" in effect.inner:
            text += _between(result, finding)
        if not effect.corrects_seat and is_constant(effect, state):
            blocks.append(Paragraph(text, detail=True))
            continue
        draw = lambda f=finding: plots.plot_cause(result, f, blank_axes(7.4, 4.0))  # noqa: E731
        blocks.append(Figure(draw, f"{words}, from the records", text))
    if any(isinstance(block, Figure) for block in blocks):
        how = (
            "Dots are records: the amount of the cause by each alone, everything else in the extended model as fitted "
            "(partial residuals). Circles are their weighted means with standard uncertainties; the line is the fitted "
            "cause. Circles on the line confirm it. Values stand with U (k = 2)."
        )
        blocks.insert(0, Paragraph(how, detail=True))
    if number := sum(geometric(result, f) for f in result.findings):
        blocks.append(
            Figure(
                lambda: plots.plot_geometry(result, blank_axes(7.4, 1.4 + 0.45 * number)),
                "Geometric values beyond their stated uncertainty",
                "Geometric values that moved farther than their stated uncertainties allow. Recalibration corrects them, "
                "and the extended model has them.",
            )
        )
    return blocks


def _between(result: Diagnosis, slip: Finding) -> str:
    """Between which records a slip was."""
    time = result.extended.problem.measurements.conditions.require("time", slip.label)[result.extended.used]
    step = slip.inner["time_s"][0]
    before, after = time[time < step], time[time >= step]
    if not (before.size and after.size):
        return ""
    return f" The fit puts it between the records at {before.max() / 60:.1f} min and {after.min() / 60:.1f} min."


def _on_the_arm(result: Diagnosis) -> list[Block]:
    from aacmm_pin.report.scenes import diagnosis_scene  # loads meshcat

    left, right = two_models(result)
    return [
        Heading("Residuals on the arm"),
        Figure(
            lambda: plots.plot_residual_views(result, blank_axes(8.6, 8.0)),
            f"Residual vectors on a drawing of the arm, {left} and {right}",
            f"Residuals in space, from each stated place towards the tip: left {left}, right {right}; above in plan, below "
            "from the side; all magnified alike. Grey: the arm in some of its postures, joints as dots. Neighbours that "
            "point the same way show what a model lacks; noise points anywhere.",
        ),
        SceneView(
            lambda: diagnosis_scene(result, left),
            f"The residuals of the {left} arm to turn: drag to look from elsewhere; the slider goes from the largest to the "
            "smallest, with the arm in its posture.",
        ),
    ]


def _held_out(result: Diagnosis) -> list[Block]:
    held = result.held_out
    if held is None:
        return [Heading("Held-out validation"), Paragraph(gain_in_words(result), detail=True)]
    table = held_out_parts(result)
    table["chosen"] = [labels_in_words(result, chosen) or "nothing" for chosen in table["chosen"]]
    sizes = ["recalibrated", "extended"]
    table = table.rename(
        columns={f"{name}_mm": name for name in sizes} | {"part": "left out", "chosen": "chosen without it"}
    )
    table[sizes] *= MM
    table, formats = in_one_unit(table, sizes)
    return [
        Heading("Held-out validation"),
        Paragraph(gain_in_words(result), finding=True, detail=True),
        Paragraph(
            f"{capital(KINDS[held.kind])} were left out in turn, of the choice of causes as well, and predicted by the "
            "other records. Gain = 1 - RMS extended / RMS recalibrated.",
            detail=True,
        ),
        Paragraph(LEFT_OUT_SEATS if held.kind == "seats" else "", detail=True),
        Figure(
            lambda: plots.plot_held_out(result, blank_axes(7.2, 3.4)),
            "RMS of each part that was left out, recalibrated and extended",
            "RMS of the held-out records of each part.",
        ),
        Table(
            table,
            "What was chosen without each part",
            formats | {"gain": percent},
            explained="A cause that is chosen every time does not depend on a few records.",
            detail=True,
        ),
    ]


def _left(result: Diagnosis) -> list[Block]:
    open_ = result.unexplained
    shapes = [
        Figure(
            lambda name=name: plots.plot_unexplained(result, name, blank_axes(7.4, 4.0)),  # type: ignore[misc]
            f"Structure over {name} without a known cause",
            f"Over {name}: {open_.acts_on[name]}. Dots: the records.",
        )
        for name in open_.shapes
    ]
    return [
        Heading("What no cause explains"),
        Paragraph(unexplained_in_words(result), finding=bool(open_.depends_on), detail=not (open_.shapes or open_.groups)),
        *_structure(open_),
        *shapes,
        *excluded_records(result.excluded),
    ]


def _structure(open_: Unexplained) -> list[Block]:
    over = [f"Over {name}: {way}." for name, way in open_.acts_on.items()]
    return [Bullets([*over, *(group_in_words(group) for group in open_.groups)])]


def _files(result: Diagnosis, summary: dict[str, Any], when: str) -> list[Block]:
    blocks = files(summary, "diagnosis.json", residuals_table(result))
    if result.model.arm.dh is not None:
        note = f"Extended by aacmm-pin diagnose on {when} (UTC) from {summary['source']}: {result}"
        what = "the extended arm: recalibrated geometry, causes, covariance"
        text = arm_text(result.model.file(), note)
        blocks.append(Download("extended.toml", text.encode(), "application/toml", what))
    return blocks


# Parts of a diagnosis by themselves --------------------------------------------------------------------------------------


@document_of.register
def finding_document(finding: Finding) -> Document:
    """A cause that was found, with what looks like it."""
    row = {
        "label": finding.label,
        "value ± U (k = 2)": values_in_words(finding.effect, finding.parameters),
        "probability": probability(finding.probability),
        "p": p_value(finding.p_value),
        "retained": percent(finding.retained_fraction),
    }
    head = "Found:" if finding.probability >= LIKELY else "Less probable than not:"
    alike = Table(pd.DataFrame([_alike(alias) for alias in finding.aliases]), "What looks like it", {"r": ".2f"})
    return Document("Finding", [Paragraph(in_words(finding.effect), head=head), Table(pd.DataFrame([row])), alike])


@document_of.register
def alias_document(alias: Alias) -> Document:
    """A look-alike."""
    return Document("Look-alike", [Table(pd.DataFrame([_alike(alias)]), "", {"r": ".2f"})])


@document_of.register
def gain_document(gain: Gain) -> Document:
    """The gain on held-out records, and the sizes of residuals behind it."""
    low, high = gain.interval
    sizes = {"simulated": gain.simulation, "recalibrated": gain.recalibrated, "extended": gain.extended}
    frame, formats = in_one_unit(pd.DataFrame({name: [rms(distance)] for name, distance in sizes.items()}), list(sizes))
    words = (
        f"{KINDS[gain.kind]}, left out in {count(gain.groups, 'part')}: gain {percent(gain.gain)} "
        f"(95 %: {100 * low:z.0f} to {percent(high)})"
    )
    return Document("Gain", [Paragraph(words, head="Held out:"), Table(frame, "RMS distance of tip and target", formats)])


@document_of.register
def unexplained_document(left: Unexplained) -> Document:
    """What depends on a column in a way that no cause has."""
    words = f"nothing depends on any column beyond chance ({p_equals(left.p_value)})."
    if left.depends_on:
        what = listed(left.depends_on)
        words = f"the residuals depend on {what} in a way that no cause has ({p_equals(left.p_value)}).{_worth(left)}"
    return Document("Unexplained", [Paragraph(words, head="Unexplained:"), *_structure(left)])


@document_of.register
def group_document(group: OddGroup) -> Document:
    """A group of records that does not agree with the others."""
    return Document("Group", [group_in_words(group)])
