"""A diagnosis as a document: verdict, residuals, causes, gain on held-out records, structure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from aacmm_pin._support.units import MM, UM, count
from aacmm_pin.calibration import residuals_by_record, rms
from aacmm_pin.diagnosis import (
    GEOMETRY,
    THRESHOLDS,
    Diagnosis,
    Finding,
    Place,
    Unexplained,
)
from aacmm_pin.effects import (
    Discrepancy,
    cause_in_words,
    corrects_seat,
    in_words,
    listed,
    location_in_words,
    probability,
    sensitivity,
    strongest_waves,
    values_in_words,
)
from aacmm_pin.report import plots
from aacmm_pin.report.calibration_page import (
    HELD_OUT_KINDS,
    excluded_records,
    files_section,
    frame_in_words,
    scene_of_residuals,
)
from aacmm_pin.report.diagnosis_json import discrepancy_to_dicts
from aacmm_pin.report.document import (
    Block,
    Bullets,
    Document,
    Figure,
    Format,
    Heading,
    Notes,
    Paragraph,
    Table,
    blank_axes,
    document_of,
)
from aacmm_pin.report.numbers import (
    capital,
    lengths,
    other_notes,
    p_equals,
    p_value,
    percent,
)
from aacmm_pin.report.plots.groups import part_in_words
from aacmm_pin.report.plots.partial_residuals import state_of, varies
from aacmm_pin.report.residual_tables import models
from aacmm_pin.report.verdicts import (
    covariate_in_words,
    labels_in_words,
    next_measurements,
    p_and_threshold,
    verdict_in_words,
)

WAVES_LISTED = 4
"""Waves of an error curve to list."""
MAX_ALIASES = 3
LEAST_SHOWN, LEAST_CORRELATION = 1e-3, 0.9
"""Least probability, or correlation, of an alias that is listed."""
SETS, LEAST_SET = 6, 0.01
"""Sets of causes that are listed: so many, of at least this probability."""
WORST = 5
"""Groups in the table; the figure has all."""
SEAT_ERRORS = (
    "The residuals at a seat are distances from the estimated position of the seat. An error of "
    "stated seat coordinates therefore hardly changes the residuals and the gain."
)
SEATS_JUDGED = (
    "diagnose compares the records of a held-out seat with its stated coordinates. The uncertainty "
    "of stated seat coordinates reduces the gain."
)
RANKED = (
    "The cause with the strongest evidence is first, and geometric values are last. The column "
    "'displacement' states the RMS displacement of the tip by the cause. The column 'probability' "
    "states how probably the cause acts. If the cause does not act, p is the probability that any "
    "cause has such large odds. The column 'not absorbed' states which part of the effect neither "
    "recalibration nor other causes absorb."
)
PLACES_LISTED = "Places of errors, and the causes that may act there"
PLACES_EXPLAINED = (
    "The first probability states how probably any cause acts at the place. The last column states "
    "how probably each cause, or each combination of causes, acts there."
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
    "recalibration does not absorb. The geometry is what the other parts leave; the last column "
    "states the shares without it."
)
GROUPS = "Groups of records that disagree with the other records; check their set-up"
"""Captions of tables, and how to read them."""


@document_of.register
def diagnosis_document(
    result: Diagnosis, summary: dict[str, Any] | None = None, when: str = ""
) -> Document:
    """The diagnosis as a document; with the content of ``diagnose --json`` a page with files of the
    date ``when`` (UTC).
    """
    planned = next_measurements(result) if summary is None else summary["next_measurements"]
    blocks = [
        *_result_section(result, planned),
        *_causes_sections(result),
        *_held_out_section(result),
        *_groups_section(result),
        scene_of_residuals(result, "recalibrated" if result.findings else "nominal"),
        *_unexplained_and_excluded_section(result),
        Notes(other_notes(result.notes)),
    ]
    subtitle = count(int(result.extended.used.sum()), "record")
    if summary is not None:
        source = summary["source"]
        note = f"aacmm-pin diagnose wrote this file on {when} (UTC) from {source}. {result}"
        names = ("diagnosis.json", "extended.toml")
        blocks += files_section(summary, residuals_table(result), result.model, names, note)
        subtitle += f" of {source}, {when} (UTC)"
    return Document(f"{result.model.arm.name}: diagnosis", blocks, subtitle)


# Sentences ------------------------------------------------------------


def diagnosis_line(result: Diagnosis) -> str:
    """Verdict, residuals and gain."""
    return f"{result.verdict}: {verdict_in_words(result)} {summary_line(result)}"


def finding_line(finding: Finding) -> str:
    """Cause, place, probability and values."""
    words = [f"probability {probability(finding.probability)}", finding_values(finding)]
    return f"{finding.label} ({', '.join(filter(None, words))})"


def certainty_in_words(result: Diagnosis) -> str:
    """The probability of the least probable named cause; "" without causes."""
    if not result.findings:
        return ""
    least = probability(min(finding.probability for finding in result.findings))
    cause = "The least probable of the named causes"
    if len(result.findings) == 1:
        cause = capital(in_words(result.findings[0].effect, result.model.arm))
    return f"{cause} acts with probability {least}."


def open_forms_in_words(result: Diagnosis) -> str:
    """The places with a certain error of open form; "" without these."""
    places = [place for place in result.places if place.form_is_open]
    sentences = []
    for place in places:
        location = location_in_words(place.effect, result.model.arm) or "the arm"
        forms = _forms_in_words(result, place)
        error = f"an error that depends on {place.depends_on}: {forms}"
        sentences.append(f"{capital(location)} certainly has {error}.")
    return " ".join(sentences)


def summary_line(result: Diagnosis) -> str:
    """Sizes of the residuals by the three models, noise, and gain on held-out records."""
    nominal, recalibrated, extended, noise = lengths(result.rms.values())
    sizes = [f"{nominal} for the nominal arm", f"{recalibrated} for the recalibrated arm"]
    if result.findings:
        sizes.append(f"{extended} for the extended arm")
    alone = "Noise alone" if result.extended.noise_is_stated else "The estimated scatter"
    sentences = [f"The RMS residual is {listed(sizes)}. {alone} would give {noise}."]
    excluded = int(result.extended.excluded.sum())
    if excluded:
        gross = "a gross error" if excluded == 1 else "gross errors"
        sentences.append(f"The fit excluded {count(excluded, 'record')} as {gross}.")
    return " ".join([*sentences, gain_in_words(result)])


def gain_in_words(result: Diagnosis) -> str:
    """The gain of the extended model on held-out records."""
    held_out = result.held_out
    if held_out is None:
        return "No records were held out, so the gain on new records is unknown."
    if np.array_equal(held_out.extended, held_out.recalibrated, equal_nan=True):
        if result.findings:
            return "Without the held-out records, diagnose would name no cause."
        return "The extended arm has no new cause, and therefore no gain on held-out records."
    low, high = held_out.interval
    sentences = [
        f"On held-out {HELD_OUT_KINDS[held_out.kind]}, the gain (reduction of the RMS residual) of "
        f"the extended arm over the recalibrated arm is {percent(held_out.gain)} (95 % interval: "
        f"{100 * low:z.0f} to {percent(high)})."
    ]
    if not held_out.beyond_doubt and high >= -THRESHOLDS.least_gain:
        sentences.append("The gain is not significant.")
    if held_out.excluded:
        excluded = count(held_out.excluded, "record")
        sentences.append(f"The gain includes {excluded} that only the extended arm excludes.")
    return " ".join(sentences)


def unexplained_in_words(unexplained: Unexplained) -> Iterator[str]:
    """Sentences on the remaining structure, or that there is none."""
    for group in unexplained.apart:
        yield f"{capital(str(group))} ({p_equals(group.p_value)})."
    tested = p_and_threshold(unexplained)
    if unexplained.acts_on:
        covariates = listed([*map(covariate_in_words, unexplained.acts_on)])
        p = p_equals(unexplained.p_value)
        yield (
            f"The residuals depend on {covariates} ({p}) in a way that no cause of the library "
            "explains."
        )
    elif unexplained.groups:
        p = p_equals(unexplained.p_value)
        yield f"Some groups of records have significantly larger residuals than the others ({p})."
    elif unexplained.left:
        yield f"The residuals have significant structure that no named cause explains ({tested})."
    else:
        yield f"The residuals do not depend significantly on a column of the file ({tested})."
    if unexplained.gain is not None and unexplained.acts_on:
        removes = f"a smooth correction removes {percent(unexplained.gain)}"
        yield f"On held-out records, {removes} of the residual that the causes leave."


def _saved_in_words(result: Diagnosis) -> Iterator[str]:
    covariates = [part.covariate for part in result.unexplained.discrepancy]
    not_saved = result.not_saved
    can_be_saved = " and on ".join(
        covariate_in_words(name) for name in covariates if name not in not_saved
    )
    if can_be_saved:
        is_saved = any(isinstance(effect, Discrepancy) for effect in result.model.effects)
        contains = "contains" if is_saved else "does not contain"
        how_to_save = "" if is_saved else "; to save it, use --with-discrepancy"
        yield (
            f"The extended arm {contains} the discrepancy that depends on "
            f"{can_be_saved}{how_to_save}."
        )
    if covariates and not_saved:
        yield (
            f"No arm file can contain the discrepancy that depends on {listed(not_saved)}, because "
            "new readings have no value of this column."
        )


# Tables ------------------------------------------------------------


def finding_values(finding: Finding) -> str:
    """Values of a cause ± U (k = 2); of an error curve, its strongest waves."""
    waves = strongest_waves(finding.effect)
    if not waves:
        return values_in_words(finding.effect, finding.parameters, finding.slides)
    unit = "µm" if finding.slides else "µrad"
    sizes = [f"{order:.3g} ({size / UM:.1f} {unit})" for order, size in waves[:WAVES_LISTED]]
    return f"waves per turn: {', '.join(sizes)}"


def ranking(result: Diagnosis) -> pd.DataFrame:
    """The causes, strongest first."""
    state, used = state_of(result.extended), result.extended.used
    rows = []
    for finding in result.findings:
        effect = finding.effect
        displacement = sensitivity(effect, state) @ np.array(effect.values)
        rows.append(
            {
                "cause": in_words(effect, result.model.arm),
                "value ± U (k = 2)": finding_values(finding),
                "displacement_mm": rms(np.linalg.norm(displacement[used], axis=1)) / MM,
                "probability": probability(finding.probability),
                "p": p_value(finding.p_value),
                "not absorbed": percent(finding.retained_fraction),
                "label": finding.label,
            }
        )
    return Table(pd.DataFrame(rows)).cells()


def places_table(result: Diagnosis) -> pd.DataFrame:
    """The places where a cause may act."""
    rows = [
        {
            "place": location_in_words(place.effect, result.model.arm) or "arm or set-up",
            "error depends on": place.depends_on.replace("_", " "),
            "probability": probability(place.probability),
            "causes": _forms_in_words(result, place),
        }
        for place in result.places
        if place.probability >= THRESHOLDS.rival
    ]
    return pd.DataFrame(rows)


def _forms_in_words(result: Diagnosis, place: Place) -> str:
    """Sets of causes that may act at a place, with their probabilities."""
    texts = []
    for labels, p in place.forms.items():
        if p >= THRESHOLDS.rival:
            causes = filter(None, map(result.cause, labels))
            names = " + ".join(cause_in_words(type(cause)) for cause in causes)
            texts.append(f"{names} {probability(p)}")
    return " or ".join(texts)


def alternatives(result: Diagnosis) -> pd.DataFrame:
    """The sets of causes with their probabilities, most probable first; all improbable sets in one
    row.
    """
    sets = result.alternatives
    likely = [labels for labels in sets if sets[labels] >= LEAST_SET][:SETS]
    rows = {
        labels_in_words(result, labels) or "none of the known causes": sets[labels]
        for labels in likely
    }
    others = len(sets) - len(likely)
    if others:
        rows[count(others, "other set")] = max(1.0 - sum(rows.values()), 0.0)
    table = pd.DataFrame(rows.items(), columns=["causes", "probability"])
    return table.assign(probability=table["probability"].map(probability))


def alias_table(result: Diagnosis) -> pd.DataFrame:
    """Aliases of each cause in these records."""
    rows = []
    for finding in result.findings:
        cause = in_words(finding.effect, result.model.arm)
        for alias in finding.aliases[:MAX_ALIASES]:
            if alias.probability > LEAST_SHOWN or abs(alias.correlation) > LEAST_CORRELATION:
                words = labels_in_words(result, [alias.label])
                chance = probability(alias.probability)
                rows.append((cause, words, alias.correlation, chance, alias.label))
    return pd.DataFrame(rows, columns=["cause", "alias", "correlation", "probability", "label"])


def residuals_table(result: Diagnosis) -> pd.DataFrame:
    """Row and labels of each record, its residual by each model and held out [mm], whether used."""
    table, held_out = residuals_by_record(models(result)), result.held_out
    if held_out is not None:
        table["part"] = held_out.folds
        table["held_out_recalibrated_mm"] = held_out.recalibrated / MM
        table["held_out_extended_mm"] = held_out.extended / MM
    return table.assign(used=result.extended.used)


# Sections ------------------------------------------------------------


def _result_section(result: Diagnosis, planned: str) -> Iterator[Block]:
    yield Heading("Result")
    sentences = {
        f"{capital(result.verdict.replace('-', ' '))}.": verdict_in_words(result),
        "Probability:": certainty_in_words(result),
        "Form not certain:": open_forms_in_words(result),
        "Residuals and gain:": summary_line(result),
        "Next:": f"{capital(planned)}.",
    }
    for head, text in sentences.items():
        if text:
            yield Paragraph(text, finding=True, head=head)
    height = 0.9 + 0.32 * len(result.budget)
    yield Figure(
        lambda: plots.plot_error_budget(result, blank_axes(6.8, height)),
        BUDGET,
        "Each bar shows the RMS displacement of the tip by one part.",
    )
    beside_geometry = sum(part.mean_square for part in result.budget if part.part != GEOMETRY)
    rows = [
        {
            "part": part_in_words(result, part),
            "rms_mm": part.rms / MM,
            "u_mm": part.u_rms / MM,
            "share": percent(part.share),
            "share without geometry": ""
            if part.part == GEOMETRY
            else percent(part.mean_square / beside_geometry),
        }
        for part in result.budget
    ]
    yield Table(pd.DataFrame(rows), BUDGET, explained=BUDGET_EXPLAINED)
    yield frame_in_words(result.of_model)
    if any(corrects_seat(finding.effect) for finding in result.findings):
        yield Paragraph(SEAT_ERRORS, detail=True)


def _groups_section(result: Diagnosis) -> Iterator[Block]:
    yield Heading("Residuals of groups of records")
    table = result.residual_groups
    if table.empty:
        yield Paragraph("The file has too few records to compare groups.", detail=True)
        return
    height = 0.5 - 2.2 * (-table["by"].nunique() // 3)
    yield Figure(
        lambda: plots.plot_groups(result, blank_axes(9.3, height)),
        "RMS residuals of groups of records by joint range, time, temperature and seat",
        "Each dot shows the RMS residual of a group of two or more records. Black dots are of the "
        "nominal arm, grey dots of the recalibrated arm, and blue dots of the extended arm. "
        "The dashed line shows the prediction for the nominal arm from the stated uncertainties "
        "and the noise. The dotted line shows the noise alone. If a blue dot is far above the "
        "dotted line, the extended arm does not explain the residuals of this group.",
    )
    worse = table[table["times_predicted"] > 1.0]
    shown = worse[["records", "nominal_mm", "predicted_mm", "extended_mm", "times_predicted"]]
    shown.insert(0, "group", worse["by"] + ": " + worse["group"])
    yield Table(
        shown,
        "Groups of records with an RMS residual of the nominal arm above the prediction from the "
        "stated uncertainties and the noise",
        {"times_predicted": ".2f"},
        {"times_predicted": "nominal / predicted"},
        most=WORST,
    )


def _causes_sections(result: Diagnosis) -> Iterator[Block]:
    yield Heading("Causes of error")
    if not result.findings:
        yield Paragraph("No cause has a probability of 0.5 or more.", detail=True)
    yield Table(places_table(result), PLACES_LISTED, explained=PLACES_EXPLAINED)
    yield Table(ranking(result), "Causes of error in the extended arm", explained=RANKED)
    for finding in result.findings:
        if varies(result, finding):
            words = capital(in_words(finding.effect, result.model.arm))
            yield Figure(
                partial(plots.plot_cause, result, finding, blank_axes(7.4, 4.0)),
                f"{words}, from the records",
                f"{words}. Each dot is the value that one record gives if all other parameters "
                "have their fitted values. Each circle is the mean of neighbouring dots, and the "
                "bar shows the standard uncertainty u of the mean. The line is the fitted cause.",
            )
    yield Heading("Other possible causes")
    yield Table(alternatives(result), SETS_LISTED, explained=ALL_SETS)
    yield Table(
        alias_table(result), ALIASES_LISTED, {"correlation": ".2f"}, explained=ALIASES_EXPLAINED
    )


def _held_out_section(result: Diagnosis) -> Iterator[Block]:
    yield Heading("Gain on held-out records")
    held_out = result.held_out
    if held_out is None:
        yield Paragraph(gain_in_words(result), detail=True)
        return
    sentences = [
        f"Each bar is the RMS residual of held-out {HELD_OUT_KINDS[held_out.kind]}. The "
        "causes and their values come from the other records.",
        "The gain is 1 - (RMS residual of the extended arm) / (RMS residual of the recalibrated "
        "arm).",
    ]
    if held_out.gross_errors:
        excluded = count(held_out.gross_errors, "record")
        sentences.append(f"The gain does not include {excluded} that both arms exclude.")
    if held_out.kind == "seats":
        sentences.append(SEATS_JUDGED)
    yield Figure(
        lambda: plots.plot_held_out(result, blank_axes(7.2, 3.4)),
        "RMS residual of the recalibrated and the extended arm in each held-out part",
        " ".join(sentences),
    )


def _unexplained_and_excluded_section(result: Diagnosis) -> Iterator[Block]:
    unexplained = result.unexplained
    yield Heading("Unexplained residuals and excluded records")
    yield from unexplained_document(unexplained).blocks
    yield Paragraph(" ".join(_saved_in_words(result)))
    for name in unexplained.acts_on:
        on = covariate_in_words(name)
        yield Figure(
            partial(plots.plot_unexplained, result, name, blank_axes(7.4, 4.0)),
            f"Structure that depends on {on} and that no cause explains",
            f"Each dot shows the structure in a record that depends on {on}.",
        )
    yield from excluded_records(result.excluded)


@document_of.register
def unexplained_document(unexplained: Unexplained) -> Document:
    """Dependences on columns that no cause explains."""
    sizes = pd.DataFrame(discrepancy_to_dicts(unexplained))
    forms: dict[str, Format] = {"covariate": covariate_in_words, "probability": probability}
    sentences = [
        f"In the structure that depends on {covariate_in_words(name)}, {sentence}."
        for name, sentence in unexplained.acts_on.items()
    ]
    groups = pd.DataFrame([asdict(group) for group in unexplained.groups])
    return Document(
        "Unexplained",
        [
            Paragraph(" ".join(unexplained_in_words(unexplained)), finding=unexplained.structure),
            Table(
                sizes,
                DISCREPANCY_AT_TIP,
                forms,
                {"covariate": "depends on"},
                explained=DISCREPANCY,
            ),
            Bullets(sentences),
            Table(
                groups,
                GROUPS,
                {"times": ".1f", "p_value": p_value},
                {"name": "group", "times": "relative residuals", "p_value": "p"},
            ),
        ],
    )
