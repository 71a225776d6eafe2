"""A diagnosis as a document: verdict, where the errors are, causes, gain on held-out
records, what is left.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM, UM, count
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import NO_SCATTER, exclusions_of, residuals_by_record, rms
from aacmm_pin.diagnosis import (
    THRESHOLDS,
    Alias,
    BudgetPart,
    Diagnosis,
    Finding,
    Gain,
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
from aacmm_pin.report.calibration import (
    HELD_OUT_KINDS,
    excluded_records,
    exclusions_in_words,
    files,
    frame_in_words,
)
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Figure,
    Format,
    Heading,
    Notes,
    Paragraph,
    SceneView,
    Table,
    blank_axes,
    document_of,
)
from aacmm_pin.report.doubts import (
    WITH_STRUCTURE,
    beside_threshold,
    doubts_in_words,
    labels_in_words,
)
from aacmm_pin.report.next_measurements import next_measurements
from aacmm_pin.report.numbers import (
    capital,
    length,
    length_unit,
    lengths,
    mistakes_in_words,
    other_notes,
    p_equals,
    p_value,
    percent,
)
from aacmm_pin.report.plots.groups import held_out_parts, part_in_words, place_in_words
from aacmm_pin.report.plots.partial_residuals import is_constant, state_of
from aacmm_pin.report.plots.residual_vectors import MODEL_WORDS, models, two_models

WAVES_LISTED = 6
"""So many waves of a free curve are listed."""
MAX_ALIASES = 3
LEAST_SHOWN, LEAST_CORRELATION = 1e-3, 0.9
"""Aliases of a cause that are listed: so many, of at least this probability or correlation."""
SETS, LEAST_SET = 6, 0.01
"""Sets of causes that are listed: so many, of at least this probability."""
ALTERNATIVES = 3
"""So many other sets of causes are named where the mass is on several."""
LEAST_PART = 0.1
"""Structure that is smaller than this part of the noise has no size worth a word."""
LEAST_WORTH = 0.005
"""Residuals that fall by a smaller part are about the same."""
WORST = 5
"""Groups that the table names; the figure has all."""
COVARIATES = {
    "record": "the order of the records",
    "place": "the place",
}
"""Covariates in words, if their name is not clear by itself."""
PREDICTED = ("predicted", "the prediction from the stated uncertainties and the noise", "dashed")
ONLY_NOISE = ("noise", "the noise alone (the arm states no uncertainty)", "dotted")
"""What residuals are compared with: in a head, in words, and its line in the figure."""
UNSTATED = (
    "You did not state all noise. The fit estimated the unstated noise from the scatter of the "
    "residuals of the extended arm."
)
SEAT_ERRORS = (
    "The residuals at a seat are distances from the estimated position of the seat. An error of "
    "stated seat coordinates therefore hardly changes the residuals and the gain."
)
SEATS_JUDGED = (
    "diagnose compares the records of a held-out seat with its stated coordinates. The uncertainty "
    "of stated seat coordinates reduces the gain."
)
RANKED = (
    "The strongest cause is first, and geometric values are last. The column 'displacement' "
    "states the RMS displacement of the tip by the cause. The column 'probability' states how "
    "probably the cause acts. If the cause does not act, p is the probability that any cause has "
    "such large odds. The column 'not absorbed' states which part of the effect neither "
    "recalibration nor other causes absorb."
)
SETS_LISTED = "Sets of causes that may act, with their probabilities"
ALL_SETS = (
    "The probabilities of all sets add up to 1. The last row states the probability of all other "
    "sets together."
)
ALIASES_LISTED = "Aliases (causes with a similar effect in these records)"
ALIASES_EXPLAINED = (
    "The column 'correlation' states the correlation of both effects in these records after a "
    "refit of the geometry. The column 'probability' states how probably the alias acts without "
    "the cause. If cause and alias act and the alias is much smaller than its typical magnitude, "
    "U of the cause is too small."
)
DISCREPANCY_AT_TIP = "Discrepancy at the tip (structure that no cause explains)"
DISCREPANCY = (
    "RMS is the displacement of the tip that recalibration does not absorb, and u is its standard "
    "uncertainty. The column 'probability' states how probably the discrepancy "
    "exists."
)
BUDGET = "What the nominal arm gets wrong, by part"
BUDGET_EXPLAINED = (
    "The mean squares of all parts add up to the mean square residual of the nominal arm, and the "
    "column 'share' states the part of each. A cause counts with the displacement that "
    "recalibration does not absorb. The geometry is what the other parts leave."
)
GROUPS = "Groups of records that disagree with the other records; check their set-up"
"""Captions of tables, and how to read them."""


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
    blocks = [*_result(result, planned), *_causes(result), *_other_causes(result)]
    blocks += [*_held_out(result), *_wrong(result), *_on_the_arm(result)]
    blocks += [*_left(result), residuals_by_row(result)]
    blocks.append(Notes(other_notes(result.notes)))
    source = ""
    if summary is not None:
        source = f" of {summary['source']}, {when} (UTC)"
        blocks += _files(result, summary, when)
    used = count(int(result.extended.used.sum()), "record")
    return Document(f"{result.model.arm.name}: diagnosis", blocks, used + source)


# Sentences ------------------------------------------------------------


def verdict_in_words(result: Diagnosis) -> str:
    """What the model lacks, that nothing was found, or that these records cannot tell; then
    what else is in doubt.
    """
    wrong = _wrong_in_words(result)
    doubts = ""
    if result.verdict in (*WITH_STRUCTURE, "ambiguous"):
        doubts = "".join(f" {capital(doubt)}." for doubt in doubts_in_words(result))
    match result.verdict:
        case "unexplained" | "partly-explained":
            text = _not_explained(result)
            if result.no_better:  # what held-out records do not confirm comes last
                text = f"{text}. {capital(wrong)}"
            elif result.findings:
                text = ". ".join([wrong, *_worth_in_words(result), capital(text)])
        case "inconclusive":
            text = _inconclusive(result, wrong)
        case "ambiguous":
            text = _ambiguous(result, wrong)
        case _:
            after = "recalibration"
            if result.findings:
                after += f" with {'this cause' if len(result.findings) == 1 else 'these causes'}"
            text = f"{wrong}. After {after}, {_left_in_words(result)}"
    mistake = mistakes_in_words(result.assumed)
    mistake += "The torque columns have the wrong sign. " if result.reversed_torques else ""
    return f"{mistake}{_excluded_in_words(result)}{capital(text)}.{doubts}"


def certainty_in_words(result: Diagnosis) -> str:
    """How probable the least probable of the named causes is; nothing if none is named."""
    if not result.findings:
        return ""
    least = probability(min(finding.probability for finding in result.findings))
    cause = "The least probable of the named causes"
    if len(result.findings) == 1:
        cause = capital(in_words(result.findings[0].effect, result.model.arm))
    return f"{cause} acts with probability {least}."


def _labels(result: Diagnosis) -> frozenset[str]:
    return frozenset(finding.label for finding in result.findings)


def _shares(result: Diagnosis) -> dict[frozenset[str], float]:
    """Probability of each set of causes, the most probable first."""
    return {frozenset(labels): share for labels, share in result.alternatives.items()}


def next_set_in_words(result: Diagnosis) -> str:
    """The most probable other set of causes, by what it has and lacks beside the named set; nothing
    if none is probable, or if the verdict names the other sets.
    """
    found, shares = _labels(result), _shares(result)
    shares.pop(found, None)
    if result.verdict == "ambiguous" or not shares:
        return ""
    likely, share = next(iter(shares.items()))
    if share < THRESHOLDS.rival:
        return ""
    more, fewer = (
        labels_in_words(result, tuple(sorted(labels)))
        for labels in (likely - found, found - likely)
    )
    if more and fewer:
        text = f"{more} may act in place of {fewer}"
    elif more:
        text = f"{more} may act{' in addition' if found else ''}"
    else:
        text = f"{fewer} may be absent" if likely else "all named causes may be absent"
    return f"{capital(text)} (probability {probability(share)})."


def _ambiguous(result: Diagnosis, wrong: str) -> str:
    """The sets of causes that share the probability."""
    found = _labels(result)
    others = [each for each in result.alternatives.items() if set(each[0]) != found]
    likely = [(labels, share) for labels, share in others if share >= THRESHOLDS.rival]
    named = []
    for labels, share in likely[:ALTERNATIVES] or others[:1]:
        causes = labels_in_words(result, labels) or "no cause"
        named.append(f"{causes} (probability of this set {probability(share)})")
    if not found:
        wrong = "these records do not determine which cause the model lacks"
        wrong += f" (probability {probability(1.0 - result.more)} that none acts)"
        if result.extended.scatters and result.extended.stated:
            wrong = f"{_left_in_words(result)}, but {wrong}"
    other = "other " if found else ""
    if len(named) == 1:
        return f"{wrong}. {capital(f'{other}possible set of causes')}: {named[0]}"
    return f"{wrong}. {capital(f'{other}possible sets of causes')}: {listed(named)}"


def _excluded_in_words(result: Diagnosis) -> str:
    """What stays unexplained for being excluded, where these records are no gross errors."""
    if result.verdict not in WITH_STRUCTURE:
        return ""
    left = exclusions_of(result.extended)
    return f"{exclusions_in_words(left)} " if left.doubtful else ""


def _wrong_in_words(result: Diagnosis) -> str:
    """What the model lacks, or may lack, and which of its values are wrong: of the geometry,
    of the places of seats.
    """
    moved = [f for f in result.findings if f.effect.remedy]
    others = [f for f in result.findings if f not in moved]
    values = [f for f in others if result.geometric(f) or corrects_seat(f.effect)]
    causes = [f for f in others if f not in values]
    text = _causes_in_words(result, causes) if causes or not moved else ""
    if moved:
        sizes = lengths([_part_of(result, f).rms for f in moved])
        named = zip((in_words(f.effect, result.model.arm) for f in moved), sizes, strict=True)
        changed = listed([f"{words}, {size} RMS" for words, size in named])
        text = "; ".join(filter(None, [f"the set-up changed: {changed}", text]))
    if result.no_better:
        text += ", but the extended arm does not predict held-out records better"
    if not values:
        return text
    off = f"some stated values have unusually large errors: {_named(values, result.model.arm)}"
    return f"{text}; {off}" if causes or moved or result.no_better else off


def _part_of(result: Diagnosis, finding: Finding) -> BudgetPart:
    """The part of the budget with a cause."""
    return next(part for part in result.budget if finding.label in part.causes)


def _causes_in_words(result: Diagnosis, causes: Sequence[Finding]) -> str:
    """Causes that the model lacks or may lack, and those whose known values are wrong."""
    sure = [f for f in causes if f.probability >= THRESHOLDS.settled and f.borne_out]
    doubtful = [f for f in causes if f not in sure]
    wrong_values = "outdated values for"
    groups = [
        ("lacks", [f for f in sure if f.was is None]),
        (f"has {wrong_values}", [f for f in sure if f.was]),
        ("may lack", [f for f in doubtful if f.was is None]),
        (f"may have {wrong_values}", [f for f in doubtful if f.was]),
    ]
    arm = result.model.arm
    clauses = [f"{verb} {_named(some, arm)}" for verb, some in groups if some]
    if clauses:
        return f"the model of {arm.name} {' and '.join(clauses)}"
    return _none_found(result)


def _none_found(result: Diagnosis) -> str:
    """That no cause was found, and how probable it is that none acts."""
    chance = probability(1.0 - result.more)
    lacks = f"the model of {result.model.arm.name} lacks (probability {chance} that none acts)"
    return f"these records show no cause of error that {lacks}"


def _named(findings: Sequence[Finding], arm: Arm) -> str:
    """Findings in a row, behind those in doubt their inclusion probability."""
    sure = [f.effect for f in findings if f.probability >= THRESHOLDS.settled]
    named = [several_in_words(sure, arm)] if sure else []
    for finding in findings:
        if finding.effect not in sure:
            chance = f"probability {probability(finding.probability)}"
            named.append(f"{in_words(finding.effect, arm)} ({chance})")
    return listed(named)


def _inconclusive(result: Diagnosis, wrong: str) -> str:
    extended = result.extended
    if not result.converged:
        note = result.converge_note
        return f"the fit did not converge ({note}), so that no conclusion is possible"
    if not extended.tells_noise:
        return "the file has too few records to distinguish a cause of error from noise"
    if extended.too_many_excluded:
        out, used = int(extended.excluded.sum()), int(extended.used.sum())
        return (
            f"{out} of {out + used} records disagree with the other records, which is too many for "
            f"gross errors. According to the other records, {wrong}"
        )
    doubts = "; ".join(doubts_in_words(result))
    if not result.findings:
        return f"these records show no cause of error, but {doubts}"
    if not doubts:
        return f"these records suggest that {wrong}"
    return f"these records suggest that {wrong}, but {doubts}"


def _not_explained(result: Diagnosis) -> str:
    unexplained = result.unexplained
    sizes, larger = _sizes_left(result)
    names = [COVARIATES.get(name, name) for name in unexplained.strongest]
    if {*unexplained.depends_on} > {*unexplained.strongest, *"xyz"}:
        names.append("other quantities")
    rms_of_parts = math.hypot(*(part.rms for part in unexplained.discrepancy))
    counts = LEAST_PART * result.noise < rms_of_parts < result.rms["recalibrated"]
    size = f" ({length(rms_of_parts)} RMS)" if counts else ""
    if names:
        how = f"depend on {listed(names)} in a way that no cause of the library explains{size}"
        more = f"the residuals {how}"
        if larger:
            more = f"{sizes}; {more}"
    elif unexplained.has_background:
        more = f"the residuals have structure{size} that depends on several quantities together"
    elif unexplained.apart and not larger:
        more = ""
    else:
        more = sizes
    return "; ".join(filter(None, [*map(str, unexplained.apart), more]))


def _worth_in_words(result: Diagnosis) -> list[str]:
    """Which part of what recalibration leaves the named causes explain; nothing if they do not."""
    held = result.held_out
    sizes, where = [result.rms["recalibrated"], result.rms["extended"]], "in these records"
    if held is not None:
        sizes, where = [rms(held.recalibrated), rms(held.extended)], "on held-out records"
    if result.no_better or sizes[1] > (1.0 - LEAST_WORTH) * sizes[0]:
        return []
    explain = "This cause explains" if len(result.findings) == 1 else "These causes explain"
    share = percent(1.0 - (sizes[1] / sizes[0]) ** 2)
    before, after = lengths(sizes)
    return [
        f"{explain} {share} of the mean square residual of the recalibrated arm {where} "
        f"(RMS {before} before, {after} after)"
    ]


def _sizes_left(result: Diagnosis) -> tuple[str, bool]:
    """How large the residuals stay, and whether that is much more than is known."""
    left = result.rms["extended"]
    text = f"the RMS residual is still {length(left)}, but the stated noise is zero"
    if result.noise > NO_SCATTER:
        text = f"the RMS residual is still {left / result.noise:.1f} times the noise"
    turned = result.extended.noise.scatters.turn if result.extended.stated else 0.0
    if turned:
        text += f", and the orientations scatter by {turned / UM:.3g} µrad more than stated"
    shared = result.unexplained.shared_by_postures
    known = result.noise * np.hypot(1.0, 0.0 if shared is None else shared.times)
    return text, bool(left > THRESHOLDS.much_more * known or turned > 0.0)


def _background(left: Unexplained) -> str:
    """The size of the background."""
    sizes = {each.covariate: each.rms for each in left.discrepancy}
    return f"{length(sizes[BACKGROUND])} RMS"


def _quantity(covariate: str) -> str:
    """What a part of the discrepancy depends on."""
    return "several quantities together" if covariate == BACKGROUND else covariate


def alias_in_words(alias: Alias, arm: Arm) -> str:
    """An alias: a cause and its place, or a covariate."""
    if alias.effect is None:
        return f"dependence on {alias.label}"
    return name_in_words(alias.effect, arm)


def summary_line(result: Diagnosis) -> str:
    """Sizes of residuals by the three models, the noise, and the gain on held-out records."""
    stated, recalibrated, extended, noise = lengths(result.rms.values())
    alone = "Noise alone" if result.extended.stated else "The estimated scatter"
    of_arms = (
        f"{stated} for the nominal arm, {recalibrated} for the recalibrated arm and {extended} for "
        "the extended arm"
        if result.findings
        else f"{stated} for the nominal arm and {recalibrated} for the recalibrated arm"
    )
    sizes = f"The RMS residual is {of_arms}. {alone} would give {noise}."
    out = int(result.extended.excluded.sum())
    gross = "a gross error" if out == 1 else "gross errors"
    excluded = f" The fit excluded {count(out, 'record')} as {gross}." if out else ""
    return f"{sizes}{excluded} {gain_in_words(result)}"


def gain_in_words(result: Diagnosis) -> str:
    """What the extended model is worth on held-out records."""
    held = result.held_out
    if held is None:
        return "No records were held out, so the gain on new records is unknown."
    if np.array_equal(held.extended, held.recalibrated, equal_nan=True):
        if result.findings:
            return "Without the held-out records, diagnose would name no cause."
        return "The extended arm has no new cause, and therefore no gain on held-out records."
    low, high = held.interval
    significant = held.beyond_doubt or high < -THRESHOLDS.least_gain
    notes = [] if significant else [" The gain is not significant."]
    interval = f"(95 % interval: {100 * low:z.0f} to {percent(high)}).{''.join(notes)}"
    arms = f"On held-out {HELD_OUT_KINDS[held.kind]}, the gain (reduction of the RMS residual)"
    over = f"of the extended arm over the recalibrated arm is {percent(held.gain)}"
    sentences = [f"{arms} {over} {interval}", _of_extended(held)]
    if result.findings and result.extended.too_many_excluded:
        sentences.append(
            "The gain may not hold at new postures, because the extended arm excludes too many "
            "records."
        )
    return " ".join(filter(None, sentences))


def _left_in_words(result: Diagnosis) -> str:
    """What is left of the residuals."""
    extended = result.extended
    if not extended.scatters:
        return "the arm agrees with the records within the noise"
    scatter = f"the residuals scatter by {length(extended.unmodelled)} per coordinate"
    if extended.stated:
        return f"{scatter} more than the stated noise"
    return f"{scatter}, which counts as noise, because you did not state all noise"


@document_of.register
def unexplained_document(left: Unexplained) -> Document:
    """What depends on a column in a way that no cause has."""
    return Document("Unexplained", _structure(left))


def unexplained_in_words(left: Unexplained) -> str:
    """What structure is left, or that none is."""
    sentences = [f"{capital(str(one))} ({p_equals(one.p_value)})." for one in left.apart]
    sentences += [f"{capital(each)}." for each in _excluded(left)]
    sentences += [*_covariates_in_words(left)]
    if left.gain is not None and (left.acts_on or left.has_background):
        removes = f"a smooth correction removes {percent(left.gain)}"
        sentences.append(f"On held-out records, {removes} of the residual that the causes leave.")
    return " ".join(sentences)


def _covariates_in_words(left: Unexplained) -> Iterator[str]:
    """What the residuals depend on, or which other structure there is."""
    p = p_equals(left.p_value)
    if left.acts_on:
        on = f"{listed([*left.acts_on])} ({p})"
        yield f"The residuals depend on {on} in a way that no cause of the library explains."
    elif left.has_background:
        size = _background(left)
        yield f"The remaining structure ({size}) depends on several quantities together."
    elif left.groups:
        yield f"Some groups of records have significantly larger residuals than the others ({p})."
    elif left.left:
        chance = beside_threshold(left)
        yield f"The residuals have significant structure that no named cause explains ({chance})."
    elif left.excluded is None:
        chance = beside_threshold(left)
        yield f"The residuals do not depend significantly on a column of the file ({chance})."


def _saved_in_words(result: Diagnosis) -> str:
    """What the extended arm has of what no cause explains."""
    parts = [each.covariate for each in result.unexplained.discrepancy]
    if not parts:
        return ""
    said, lost = [], result.not_saved
    saved = " and on ".join(_quantity(name) for name in parts if name not in lost)
    if saved:
        there = any(isinstance(effect, Discrepancy) for effect in result.model.effects)
        has = "contains" if there else "does not contain"
        how = "" if there else "; to save it, use --with-discrepancy"
        said.append(f"The extended arm {has} the discrepancy that depends on {saved}{how}.")
    if lost:
        over = f"No arm file can contain the discrepancy that depends on {listed(lost)}"
        said.append(f"{over}, because new readings have no value of this column.")
    return " ".join(said)


def _excluded(left: Unexplained) -> list[str]:
    """What the excluded records share."""
    shared = left.excluded
    if shared is None:
        return []
    if shared.excluded == 1:
        return [f"the records around the excluded record have {shared.where}"]
    how_many = "all" if shared.excluded == shared.of else f"{shared.excluded} of"
    return [f"{how_many} {shared.of} excluded records have {shared.where}"]


# Tables ------------------------------------------------------------


def motion_of(result: Diagnosis, effect: Effect, state: State | None = None) -> float:
    """RMS by which a cause moves the tip, or the stated place, over the used records [m];
    ``state``: extended arm.
    """
    state = state or state_of(result.extended)
    moved = sensitivity(effect, state) @ np.array(effect.values)
    distances = np.linalg.norm(moved[result.extended.used], axis=1)
    return rms(distances)


def ranking(result: Diagnosis) -> pd.DataFrame:
    """The causes, strongest first: cause, value ± U, size at the tip, probability, p, not absorbed,
    label.
    """
    state = state_of(result.extended)
    rows = [_rank(result, finding, state) for finding in result.findings]
    return Table(pd.DataFrame(rows)).cells()


def _rank(result: Diagnosis, f: Finding, state: State) -> dict[str, Any]:
    row: dict[str, Any] = {"cause": in_words(f.effect, result.model.arm)}
    row["value ± U (k = 2)"] = values_in_words(f.effect, f.parameters, f.slides)
    row["displacement_mm"] = motion_of(result, f.effect, state) / MM
    row |= {"probability": probability(f.probability), "p": p_value(f.p_value)}
    return row | {"not absorbed": percent(f.retained_fraction), "label": f.label}


def alternatives(result: Diagnosis) -> pd.DataFrame:
    """The sets of causes, most probable first: causes, probability; last all others together."""
    likely = [each for each in result.alternatives.items() if each[1] >= LEAST_SET][:SETS]
    rows, rest = [], 1.0
    for labels, share in likely:
        words = labels_in_words(result, labels) or "none of the known causes"
        rows.append((words, probability(share)))
    others = len(result.alternatives) - len(likely)
    if others:
        rest = 1.0 - sum(share for _, share in likely)
        rows.append((count(others, "other set"), probability(max(rest, 0.0))))
    return pd.DataFrame(rows, columns=["causes", "probability"])


def alias_table(result: Diagnosis) -> pd.DataFrame:
    """Aliases of each cause in these records: cause, alias, correlation, probability of the alias
    alone, label.
    """
    rows = []
    for finding in result.findings:
        for alias in finding.aliases[:MAX_ALIASES]:
            if alias.probability > LEAST_SHOWN or abs(alias.correlation) > LEAST_CORRELATION:
                rows.append(_alias_row(finding, alias, result.model.arm))
    return pd.DataFrame(rows)


def _alias_row(finding: Finding, alias: Alias, arm: Arm) -> dict[str, Any]:
    names = {"cause": in_words(finding.effect, arm), "alias": alias_in_words(alias, arm)}
    numbers = {"correlation": alias.correlation, "probability": probability(alias.probability)}
    return {**names, **numbers, "label": alias.label}


def discrepancy_table(left: Unexplained) -> pd.DataFrame:
    """What no cause explains: covariate, size at the tip, u, probability."""
    rows = []
    for part in left.discrepancy:
        sizes = {"rms_mm": part.rms / MM, "u_mm": part.u / MM}
        chance = {"probability": probability(part.probability)}
        rows.append({"depends on": _quantity(part.covariate), **sizes, **chance})
    return pd.DataFrame(rows)


def residuals_table(result: Diagnosis) -> pd.DataFrame:
    """One row a record: line of the file, labels, tip minus target by each model and held out [mm],
    whether it was used.
    """
    table = residuals_by_record(models(result))
    if result.held_out is not None:
        table["part"] = result.held_out.part
        for name in ("recalibrated", "extended"):
            table[f"held_out_{name}_mm"] = getattr(result.held_out, name) / MM
    return table.assign(used=result.extended.used)


# Sections ------------------------------------------------------------


def answers(result: Diagnosis, planned: str) -> list[Block]:
    """The verdict, its probability, other possible causes, residuals and gain, and what to
    measure next.
    """
    verdict = f"{capital(result.verdict.replace('-', ' '))}."
    sentences = {verdict: verdict_in_words(result)}
    sentences["Probability:"] = certainty_in_words(result)
    sentences["Other possible causes:"] = next_set_in_words(result)
    sentences["Residuals and gain:"] = summary_line(result)
    sentences["Next:"] = f"{capital(planned)}."
    return [Paragraph(text, True, head) for head, text in sentences.items() if text]


def _result(result: Diagnosis, planned: str) -> list[Block]:
    hints = [] if result.extended.stated else [UNSTATED]
    if any(corrects_seat(finding.effect) for finding in result.findings):
        hints.append(SEAT_ERRORS)
    hint = Paragraph(" ".join(hints), detail=True)
    base = Paragraph(frame_in_words(result.extended))
    blocks = [Heading("Result"), *answers(result, planned), *_budget(result)]
    return [*blocks, rms_figure(result), base, hint]


def budget_table(result: Diagnosis) -> pd.DataFrame:
    """The parts of the mean square residual of the nominal arm: part, RMS and its u, share."""
    rows = []
    for part in result.budget:
        sizes = {"rms_mm": part.rms / MM, "u_mm": part.u_rms / MM}
        rows.append({"part": part_in_words(result, part), **sizes, "share": percent(part.share)})
    return pd.DataFrame(rows)


def _budget(result: Diagnosis) -> list[Block]:
    height = 0.9 + 0.32 * len(result.budget)
    figure = Figure(
        lambda: plots.plot_error_budget(result, blank_axes(6.8, height)),
        BUDGET,
        "Each bar shows the RMS displacement of the tip by one part.",
    )
    return [figure, Table(budget_table(result), BUDGET, explained=BUDGET_EXPLAINED)]


def residuals_by_row(result: Diagnosis) -> Figure:
    """The signed residuals in the order of the records."""
    return Figure(
        lambda: plots.plot_residuals_by_row(result, blank_axes(7.4, 3.2)),
        "Signed residuals of the extended arm in the order of the records",
        "Each dot shows one coordinate of one residual. If neighbouring dots have the "
        "same sign, consecutive records share an error.",
    )


def rms_figure(result: Diagnosis) -> Figure:
    """Sizes of the residuals by the three models."""
    return Figure(
        lambda: plots.plot_rms(result, blank_axes(6.8, 2.0)),
        "RMS residuals of the three models",
        "The bars show the RMS residuals of the nominal arm, of the recalibrated arm, and of an "
        "arm that causes extend. The fit estimates an unknown frame or target for each arm. The "
        "dashed line shows the RMS residual that noise alone would give.",
    )


def _wrong(result: Diagnosis) -> list[Block]:
    title, table = Heading("Residuals of groups of records"), result.residual_groups
    if table.empty:
        return [title, Paragraph("The file has too few records to compare groups.", detail=True)]
    predicted, beside, line = PREDICTED
    if table["predicted_mm"].equals(table["noise_mm"]):
        predicted, beside, line = ONLY_NOISE
    height = 0.5 - 2.2 * (-table["by"].nunique() // 3)
    figure = Figure(
        lambda: plots.plot_groups(result, blank_axes(9.3, height)),
        "RMS residuals of groups of records by joint range, time, temperature and seat",
        "Each dot shows the RMS residual of a group of two or more records. Black dots are of the "
        "nominal arm, grey dots of the recalibrated arm, and blue dots of the extended arm. "
        f"Compare the black dots with the {line} line, which shows {beside}. Compare the blue dots "
        "with the dotted line, which shows the noise alone. If a blue dot is far above the dotted "
        "line, the extended arm does not explain the residuals of this group.",
    )
    worst = _worst(result, predicted)
    if worst.empty:
        none = f"No group of records has an RMS residual of the nominal arm above {beside}."
        return [title, figure, Paragraph(none)]
    caption = f"Groups of records with an RMS residual of the nominal arm above {beside}"
    return [title, figure, Table(worst, caption, {f"nominal / {predicted}": ".2f"}, most=WORST)]


def _worst(result: Diagnosis, predicted: str) -> pd.DataFrame:
    """Groups that are farther off than predicted, the worst first, in the unit of the RMS
    of all.
    """
    table = result.residual_groups
    worse = table[table["times_predicted"] > 1.0]
    unit, scale = length_unit(max(result.rms.values()))
    where = [*map(place_in_words, worse["by"], worse["group"])]
    found = pd.DataFrame({"group": where, "records": worse["records"]})
    heads = {"simulation": "nominal", "predicted": predicted, "extended": "extended"}
    for name, head in heads.items():
        found[f"{head} [{unit}]"] = worse[f"{name}_mm"] * (MM / scale)
    found[f"nominal / {predicted}"] = worse["times_predicted"]
    return found


def _causes(result: Diagnosis) -> list[Block]:
    none = "" if result.findings else "No cause has a probability of 0.5 or more."
    causes = Table(ranking(result), "Causes of error in the extended arm", explained=RANKED)
    return [
        Heading("Causes of error"),
        Paragraph(none, detail=True),
        causes,
        Bullets(_waves(result)),
        *causes_drawn(result),
    ]


def _other_causes(result: Diagnosis) -> list[Block]:
    apart = [labels_in_words(result, labels) for labels in result.cannot_tell_apart]
    open_ = Bullets([f"These records do not distinguish {labels}." for labels in apart])
    sets = Table(alternatives(result), SETS_LISTED, explained=ALL_SETS)
    forms = {"correlation": ".2f"}
    aliases = Table(alias_table(result), ALIASES_LISTED, forms, explained=ALIASES_EXPLAINED)
    return [Heading("Other possible causes"), sets, open_, aliases]


def _waves(result: Diagnosis) -> list[str]:
    """The strongest waves of each free curve."""
    lines = []
    for finding in result.findings:
        waves = strongest_waves(finding.effect)
        if waves:
            sizes = [f"{n:.3g} ({size / UM:.1f} µrad)" for n, size in waves[:WAVES_LISTED]]
            name = capital(in_words(finding.effect, result.model.arm))
            lines.append(f"{name} has its strongest waves at {listed(sizes)} periods per turn.")
    return lines


def causes_drawn(result: Diagnosis) -> list[Block]:
    """A figure of each cause that depends on something, and one of all geometric values."""
    state = state_of(result.extended)
    blocks: list[Block] = []
    for finding in result.findings:
        effect = finding.effect
        constant = is_constant(effect, state) and not corrects_seat(effect)
        if not (result.geometric(finding) or constant):
            blocks.append(_cause_drawn(result, finding))
    number = sum(map(result.geometric, result.findings))
    if number:
        height = 1.4 + 0.45 * number
        figure = Figure(
            lambda: plots.plot_geometry(result, blank_axes(7.4, height)),
            "Geometric values beyond their stated uncertainty",
            "The dots show geometric values that changed by more than their stated uncertainties "
            "allow.",
        )
        blocks.append(figure)
    return blocks


def _cause_drawn(result: Diagnosis, finding: Finding) -> Figure:
    words = capital(in_words(finding.effect, result.model.arm))
    return Figure(
        lambda: plots.plot_cause(result, finding, blank_axes(7.4, 4.0)),
        f"{words}, from the records",
        f"{words}. Each dot is the value that one record gives if all other parameters have their "
        "fitted values. Each circle is the mean of neighbouring dots, and the bar shows the "
        "standard uncertainty u of the mean. The line is the fitted cause.",
    )


def _on_the_arm(result: Diagnosis) -> list[Block]:
    from aacmm_pin.report.scenes import residual_scene  # loads meshcat

    models = two_models(result)
    left, right = (MODEL_WORDS.get(name, name) for name in models)
    figure = Figure(
        lambda: plots.plot_residual_views(result, blank_axes(8.6, 8.0)),
        f"Residual vectors of the {left} and the {right} arm",
        "Each line is a residual from reference to tip, and all lines have the same magnification. "
        f"The left panels show the {left} arm, and the right panels the {right} arm. The upper "
        "panels are plan views, and the lower panels are side views. The grey lines show the arm. "
        "If neighbouring lines have the same direction, the model lacks a cause of error.",
    )
    scene = SceneView(
        lambda: residual_scene(result, models[0]),
        f"The scene shows the residuals of the {left} arm. Drag to rotate the view. The slider "
        "shows the arm in the posture of each residual, from the largest residual to the smallest.",
    )
    return [figure, scene]


def _held_out(result: Diagnosis) -> list[Block]:
    held, title = result.held_out, Heading("Gain on held-out records")
    if held is None:
        return [title, Paragraph(gain_in_words(result), detail=True)]
    table = held_out_parts(result)[["part", "records", "gain", "chosen"]]
    chosen = [labels_in_words(result, labels) or "nothing" for labels in table.pop("chosen")]
    table = table.rename(columns={"part": "held-out part"})
    table = table.assign(**{"chosen causes": chosen})
    sentences = [
        f"Each bar is the RMS residual of held-out {HELD_OUT_KINDS[held.kind]}. The "
        "causes and their values come from the other records.",
        "The gain is 1 - (RMS residual of the extended arm) / (RMS residual of the recalibrated "
        "arm).",
        _counted(held),
    ]
    if held.kind == "seats":
        sentences.append(SEATS_JUDGED)
    figure = Figure(
        lambda: plots.plot_held_out(result, blank_axes(7.2, 3.4)),
        "RMS residual of the recalibrated and the extended arm in each held-out part",
        " ".join(sentences),
    )
    caption = "Causes that diagnose chose without the held-out part"
    return [title, figure, Table(table, caption, {"gain": percent}, detail=True)]


def _counted(held: Gain) -> str:
    """Which excluded records count in the gain."""
    if not held.gross_errors:
        return _of_extended(held)
    few = count(held.gross_errors, "record")
    out = f"The gain does not include {few} that both arms exclude."
    return f"{_of_extended(held)} {out}".strip()


def _of_extended(held: Gain) -> str:
    """How many records count in the gain though the extended arm excludes them."""
    if not held.excluded:
        return ""
    few = count(held.excluded, "record")
    return f"The gain includes {few} that only the extended arm excludes."


def _left(result: Diagnosis) -> list[Block]:
    left = result.unexplained
    blocks: list[Block] = [Heading("Unexplained residuals and excluded records"), *_structure(left)]
    blocks.append(Paragraph(_saved_in_words(result)))
    blocks += [_shape(result, name) for name in left.shapes]
    return [*blocks, *excluded_records(result.excluded)]


def _shape(result: Diagnosis, name: str) -> Figure:
    way = result.unexplained.acts_on[name]
    return Figure(
        lambda: plots.plot_unexplained(result, name, blank_axes(7.4, 4.0)),
        f"Structure that depends on {name} and that no cause explains",
        f"In the structure that depends on {name}, {way}. Each dot is a record.",
    )


def _structure(left: Unexplained) -> list[Block]:
    groups = pd.DataFrame([asdict(group) for group in left.groups])
    forms: dict[str, Format] = {"times": ".1f", "p_value": p_value}
    heads = {"name": "group", "times": "relative residuals", "p_value": "p"}
    ways = [
        f"In the structure that depends on {name}, {way}." for name, way in left.acts_on.items()
    ]
    return [
        Paragraph(unexplained_in_words(left), finding=left.structure),
        Table(discrepancy_table(left), DISCREPANCY_AT_TIP, explained=DISCREPANCY),
        Bullets(ways),
        Table(groups, GROUPS, forms, heads),
    ]


def _files(result: Diagnosis, summary: dict[str, Any], when: str) -> list[Block]:
    note = f"aacmm-pin diagnose wrote this file on {when} (UTC) from {summary['source']}. {result}"
    names = ("diagnosis.json", "extended.toml")
    return files(summary, residuals_table(result), result.model, names, note)
