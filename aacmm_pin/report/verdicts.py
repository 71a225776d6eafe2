"""What the report says of each verdict and doubt of a diagnosis: :data:`VERDICTS`,
:data:`WORDS_OF_DOUBTS`.

The pages show the docstrings: meaning and advice of a verdict, meaning of a doubt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.units import UM, count
from aacmm_pin.arm import Arm
from aacmm_pin.calibration import NO_SCATTER, exclusions_of
from aacmm_pin.diagnosis import THRESHOLDS, Diagnosis, Finding, Unexplained
from aacmm_pin.diagnosis.verdict import Verdict
from aacmm_pin.effects import (
    corrects_seat,
    in_words,
    listed,
    name_in_words,
    probability,
    several_in_words,
)
from aacmm_pin.report.calibration_page import exclusions_in_words
from aacmm_pin.report.next_steps import (
    MORE_RECORDS,
    step_for_odd_records,
    step_for_seats,
    step_for_structure,
    step_to_distinguish,
    step_with_extended_arm,
    step_without_causes,
    urgent_step,
)
from aacmm_pin.report.numbers import (
    capital,
    length,
    mistakes_in_words,
    p_equals,
)

ALTERNATIVES = 3
"""Other sets of causes to name."""
LEAST_PART = 0.1
"""Least part of the noise of structure whose size is stated."""
COVARIATES = {
    "record": "the order of the records",
    "place": "the position of the tip",
}
"""Covariates whose names need other words."""
LACKS = {
    (True, False): "lacks",
    (True, True): "has outdated values for",
    (False, False): "may lack",
    (False, True): "may have outdated values for",
}
"""Verbs by whether a cause is certain, and whether the model knows it."""


@dataclass(frozen=True)
class VerdictText:
    """What the report says of a verdict.

    Attributes:
        sentence: its function, whose docstring has the row of the pages: first what the verdict
            means, then what to do.
        next_step: the advice, unless :func:`urgent_step` has another.
        doubts_follow: the doubts follow the sentence.
        with_structure: causes may be named beside structure that no cause explains.
    """

    sentence: Callable[[Diagnosis], str]
    next_step: Callable[[Diagnosis], str]
    doubts_follow: bool = False
    with_structure: bool = False


def verdict_in_words(result: Diagnosis) -> str:
    """The sentence of the verdict, after mistakes in files and before doubts."""
    mistakes, doubts, text = mistakes_in_words(result.assumed), "", VERDICTS[result.verdict]
    if result.reversed_torques:
        mistakes += "The torque columns have the wrong sign. "
    exclusions = exclusions_of(result.extended)
    if exclusions.doubtful and text.with_structure:
        mistakes += f"{exclusions_in_words(exclusions)} "
    if text.doubts_follow:
        doubts = "".join(f" {capital(doubt)}." for doubt in doubts_in_words(result))
    return f"{mistakes}{capital(text.sentence(result))}.{doubts}"


def next_measurements(result: Diagnosis) -> str:
    """A sentence with the next measurements that a diagnosis recommends.

    If the records cannot distinguish two causes, it has the command for a plan.
    """
    text = VERDICTS[result.verdict]
    step = urgent_step(result, text.with_structure) or text.next_step(result)
    if text.with_structure and result.cannot_tell_apart:
        return f"{step}. Then {step_to_distinguish(result)}"
    return step


# Verdicts -------------------------------------------------------------


def _explained(result: Diagnosis) -> str:
    """Each named cause has a probability of at least 0.95, and improves the prediction of held-out
    records, if any. Every other cause has a probability below 0.5.

    Use the extended arm, and check it on new records.
    """
    causes = "this cause" if len(result.findings) == 1 else "these causes"
    findings = _findings_in_words(result)
    return f"{findings}. After recalibration with {causes}, {_residuals_left(result)}"


def _ambiguous(result: Diagnosis) -> str:
    """Several sets of causes fit the records about equally well.

    Follow the line *Next* in the output.
    """
    named = {finding.label for finding in result.findings}
    others = {labels: p for labels, p in result.alternatives.items() if set(labels) != named}
    likely = [labels for labels, p in others.items() if p >= THRESHOLDS.rival]
    sets = []
    for labels in likely[:ALTERNATIVES] or [*others][:1]:
        causes = labels_in_words(result, labels) or "no cause"
        sets.append(f"{causes} (probability of this set {probability(others[labels])})")
    findings = _findings_in_words(result)
    if not result.findings:
        chance = probability(1.0 - result.more)
        findings = "these records do not determine which cause the model lacks"
        findings += f" (probability {chance} that none acts)"
        if result.extended.has_scatter and result.extended.noise_is_stated:
            findings = f"{_residuals_left(result)}, but {findings}"
    possible = "other possible" if result.findings else "possible"
    set_or_sets = "set" if len(sets) == 1 else "sets"
    return f"{findings}. {capital(f'{possible} {set_or_sets} of causes')}: {listed(sets)}"


def _partly_explained(result: Diagnosis) -> str:
    """The residuals have structure that no cause explains. Causes with a probability of at least
    0.95, which held-out records confirm, displace the tip by more than this structure.

    Use the extended arm, and check it on new records. For the structure, see the table *Reasons for
    `unexplained`*.
    """
    structure = _structure_in_words(result)
    if result.no_better:  # what held-out records do not confirm comes last
        return f"{structure}. {capital(_findings_in_words(result))}"
    if not result.findings:
        return structure
    return f"{_findings_in_words(result)}. {capital(structure)}"


def _unexplained(result: Diagnosis) -> str:
    """`diagnose` cannot explain all of the residuals, or one group of records disagrees with the
    others.

    See the table *Reasons for `unexplained`*.
    """
    return _partly_explained(result)


def _no_discrepancy(result: Diagnosis) -> str:
    """The residuals of the recalibrated arm are as small as the noise. `diagnose` would find more
    than half of all causes of typical magnitude in the records.

    Read in the line *Next* how many causes `diagnose` would find. Keep the records for comparison
    with the next check.
    """
    return f"{_findings_in_words(result)}. After recalibration, {_residuals_left(result)}"


def _inconclusive(result: Diagnosis) -> str:
    """The records allow no conclusion. The output states the reason.

    See the table *Reasons for `inconclusive`*.
    """
    extended, findings = result.extended, _findings_in_words(result)
    if not result.converged:
        return (
            f"the fit did not converge ({result.converge_note}), so that no conclusion is possible"
        )
    if not extended.determines_noise:
        return "the file has too few records to distinguish a cause of error from noise"
    if extended.too_many_excluded:
        excluded, used = int(extended.excluded.sum()), int(extended.used.sum())
        return (
            f"{excluded} of {excluded + used} records disagree with the other records, which is "
            f"too many for gross errors. According to the other records, {findings}"
        )
    doubts = "; ".join(doubts_in_words(result))
    if not result.findings:
        return f"these records show no cause of error, but {doubts}"
    return f"these records suggest that {findings}" + (f", but {doubts}" if doubts else "")


# Next steps of verdicts -------------------------------------------------


def _after_explained(result: Diagnosis) -> str:
    odd_records = step_for_odd_records(result)
    return odd_records or step_for_seats(result) or step_with_extended_arm(result)


def _after_ambiguous(result: Diagnosis) -> str:
    return step_for_odd_records(result) or step_to_distinguish(result, _doubtful(result))


def _after_structure(result: Diagnosis) -> str:
    return step_for_odd_records(result) or step_for_structure(result)


def _after_inconclusive(result: Diagnosis) -> str:
    doubts = doubts_in_words(result) or ["these records do not confirm the named causes"]
    more_records = f"{MORE_RECORDS}, because {'; '.join(doubts)}"
    if not result.findings:
        return more_records
    doubtful = _doubtful(result)
    distinguish = step_to_distinguish(result, doubtful) if doubtful else step_for_seats(result)
    return step_for_odd_records(result) or distinguish or more_records


def _doubtful(result: Diagnosis) -> list[Finding]:
    return [finding for finding in result.findings if not _is_settled(finding)]


VERDICTS: Mapping[Verdict, VerdictText] = {
    "explained": VerdictText(_explained, _after_explained),
    "ambiguous": VerdictText(_ambiguous, _after_ambiguous, doubts_follow=True),
    "partly-explained": VerdictText(
        _partly_explained, _after_structure, doubts_follow=True, with_structure=True
    ),
    "unexplained": VerdictText(
        _unexplained, _after_structure, doubts_follow=True, with_structure=True
    ),
    "no-discrepancy": VerdictText(_no_discrepancy, step_without_causes),
    "inconclusive": VerdictText(_inconclusive, _after_inconclusive),
}
"""The words of each verdict, by its name."""


def _findings_in_words(result: Diagnosis) -> str:
    """What the model lacks or may lack, and which values of geometry and seats are wrong."""
    arm = result.model.arm
    of_set_up: list[Finding] = []
    of_values: list[Finding] = []
    causes: list[Finding] = []
    for finding in result.findings:
        if finding.effect.remedy:
            of_set_up.append(finding)
        elif result.geometric(finding) or corrects_seat(finding.effect):
            of_values.append(finding)
        else:
            causes.append(finding)
    clauses = []
    if of_set_up:
        changes = [in_words(finding.effect, arm) for finding in of_set_up]
        clauses.append(f"the set-up changed: {listed(changes)}")
    if causes:
        clauses.append(f"the model of {arm.name} {_lacking_in_words(causes, arm)}")
    elif not of_set_up and (result.no_better or not of_values):
        chance = f"(probability {probability(1.0 - result.more)} that none acts)"
        lacks = f"no cause of error that the model of {arm.name} lacks {chance}"
        clauses.append(f"these records show {lacks}")
    if result.no_better:
        clauses[-1] += ", but the extended arm does not predict held-out records better"
    if of_values:
        wrong_values = _causes_in_words(of_values, arm)
        clauses.append(f"some stated values have unusually large errors: {wrong_values}")
    return "; ".join(clauses)


def _lacking_in_words(causes: Sequence[Finding], arm: Arm) -> str:
    """Verbs of :data:`LACKS`, each with the causes of which it is true."""
    by_verb: dict[str, list[Finding]] = {verb: [] for verb in LACKS.values()}
    for finding in causes:
        certain = _is_settled(finding) and finding.borne_out
        by_verb[LACKS[certain, finding.was is not None]].append(finding)
    clauses = [
        f"{verb} {_causes_in_words(findings, arm)}"
        for verb, findings in by_verb.items()
        if findings
    ]
    return " and ".join(clauses)


def _is_settled(finding: Finding) -> bool:
    return finding.probability >= THRESHOLDS.settled


def _causes_in_words(findings: Iterable[Finding], arm: Arm) -> str:
    """Settled causes together, then each other cause with its probability."""
    certain = [f.effect for f in findings if _is_settled(f)]
    names = [several_in_words(certain, arm)] if certain else []
    for finding in findings:
        if not _is_settled(finding):
            chance = f"probability {probability(finding.probability)}"
            names.append(f"{in_words(finding.effect, arm)} ({chance})")
    return listed(names)


def _structure_in_words(result: Diagnosis) -> str:
    """What residuals depend on, which groups disagree, or how large residuals are."""
    unexplained = result.unexplained
    size_of_residuals, much_larger = _size_of_residuals(result)
    names = [covariate_in_words(name) for name in unexplained.strongest]
    if {*unexplained.depends_on} > {*unexplained.strongest, *"xyz"}:
        names.append("other quantities")
    structure_rms = math.hypot(*(part.rms for part in unexplained.discrepancy))
    is_worth_stating = LEAST_PART * result.noise < structure_rms < result.rms["recalibrated"]
    details = [f"{length(structure_rms)} RMS"] if is_worth_stating else []
    most_probable = max((part.probability for part in unexplained.discrepancy), default=1.0)
    if most_probable < THRESHOLDS.settled:
        details.append(f"probability {probability(most_probable)}")
    in_brackets = f" ({', '.join(details)})" if details else ""
    clauses = [str(group) for group in unexplained.apart]
    if much_larger or not (names or unexplained.apart):
        clauses.append(size_of_residuals)
    if names:
        clauses.append(
            f"the residuals depend on {listed(names)} in a way that no cause of the library "
            f"explains{in_brackets}"
        )
    return "; ".join(clauses)


def _size_of_residuals(result: Diagnosis) -> tuple[str, bool]:
    """The clause on their size; whether this is much more than noise."""
    rms, noise, extended = result.rms["extended"], result.noise, result.extended
    text = f"the RMS residual is still {length(rms)}, but the stated noise is zero"
    if noise > NO_SCATTER:
        text = f"the RMS residual is still {rms / noise:.1f} times the noise"
    rotation_scatter = extended.noise.scatters.rotation if extended.noise_is_stated else 0.0
    if rotation_scatter:
        text += (
            f", and the orientations scatter by {rotation_scatter / UM:.3g} µrad more than stated"
        )
    shared_error = result.unexplained.shared_by_postures
    expected = noise * np.hypot(1.0, 0.0 if shared_error is None else shared_error.times)
    return text, bool(rms > THRESHOLDS.much_more * expected or rotation_scatter > 0.0)


def _residuals_left(result: Diagnosis) -> str:
    extended = result.extended
    if not extended.has_scatter:
        return "the arm agrees with the records within the noise"
    scatter = f"the residuals scatter by {length(extended.scatter)} per coordinate"
    if extended.noise_is_stated:
        return f"{scatter} more than the stated noise"
    return f"{scatter}, which counts as noise, because you did not state all noise"


# Doubts ---------------------------------------------------------------


def doubts_in_words(result: Diagnosis) -> list[str]:
    """Sentences of the doubts that the verdict does not state.

    Raises:
        KeyError: a doubt has no sentence.
    """
    return [*filter(None, (WORDS_OF_DOUBTS[doubt](result) for doubt in result.doubts))]


def _contradicted_references(result: Diagnosis) -> str:
    """The stated coordinates of a seat, or a stated length, contradict the records."""
    return "; ".join(map(str, result.contradicted))


def _residuals_too_small(_: Diagnosis) -> str:
    """The residuals are far smaller than the stated noise, so that noise can hide every cause."""
    return (
        "the residuals are far smaller than the stated noise, and noise of this size hides causes"
    )


def _few_causes_shown(result: Diagnosis) -> str:
    """`diagnose` found no cause, and the records would show at most half of all causes."""
    shown, tried = result.visible
    return f"these records would show only {shown} of {count(tried, 'cause')} of typical magnitude"


def _cause_not_named(result: Diagnosis) -> str:
    """`diagnose` would find a cause only with the excluded records."""
    excluded = count(int(result.extended.excluded.sum()), "excluded record")
    causes = labels_in_words(result, result.otherwise)
    return f"with the {excluded}, diagnose would find {causes}"


def _below_zero(result: Diagnosis) -> str:
    """The estimate of a cause is negative by more than U, which is physically impossible."""
    causes = several_in_words(result.below_zero, result.model.arm)
    return f"the estimate of {causes} is negative, which is physically impossible"


def _not_borne_out(result: Diagnosis) -> str:
    """Held-out records do not confirm a cause."""
    if "no better" in result.doubts:
        return ""
    unconfirmed = [finding.effect for finding in result.findings if not finding.borne_out]
    return f"held-out records do not confirm {several_in_words(unconfirmed, result.model.arm)}"


def _no_better(result: Diagnosis) -> str:
    """The extended arm does not predict held-out records better than the recalibrated arm."""
    return ""


def _structure_left(result: Diagnosis) -> str:
    """The residuals have significant structure (`unexplained.p_value` is below the threshold)."""
    if VERDICTS[result.verdict].with_structure or "more causes" in result.doubts:
        return ""
    return f"the residuals have significant structure ({p_and_threshold(result.unexplained)})"


def _more_causes(result: Diagnosis) -> str:
    """A cause that `diagnose` cannot identify acts with a probability of at least 0.95."""
    if result.verdict == "ambiguous" and not result.findings:
        return ""  # the sets that may act are in the sentence
    chance = f"probability {probability(result.more)}, threshold {THRESHOLDS.settled:g}"
    return f"diagnose cannot identify a further cause that acts ({chance})"


def _starts_disagree(result: Diagnosis) -> str:
    """Two searches over the sets of causes found different sets (`agreement`)."""
    return "two searches over the sets of causes found different sets"


WORDS_OF_DOUBTS: Mapping[str, Callable[[Diagnosis], str]] = {
    "contradicted references": _contradicted_references,
    "residuals too small": _residuals_too_small,
    "few causes shown": _few_causes_shown,
    "cause not named": _cause_not_named,
    "below zero": _below_zero,
    "cause not borne out": _not_borne_out,
    "no better": _no_better,
    "structure left": _structure_left,
    "more causes": _more_causes,
    "starts disagree": _starts_disagree,
}
"""The sentence of each doubt, by its name; empty if the verdict, or another doubt, states it."""


def p_and_threshold(unexplained: Unexplained) -> str:
    """The p-value and its threshold: ``p = 0.02, threshold 0.001``."""
    return f"{p_equals(unexplained.p_value)}, threshold {unexplained.threshold:g}"


def covariate_in_words(name: str) -> str:
    """What structure depends on."""
    return COVARIATES.get(name, name)


def labels_in_words(result: Diagnosis, labels: Sequence[str]) -> str:
    """Causes and covariates that labels of the result name."""
    names = []
    for label in labels:
        cause = result.cause(label)
        dependence = f"dependence on {covariate_in_words(label)}"
        names.append(dependence if cause is None else name_in_words(cause, result.model.arm))
    return listed(names)
