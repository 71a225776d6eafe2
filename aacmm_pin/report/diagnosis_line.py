"""A diagnosis and a cause in one line: what ``print`` shows of them."""

from __future__ import annotations

from collections.abc import Iterator

from aacmm_pin._support.units import MM
from aacmm_pin.diagnosis import Diagnosis, Finding, Gain
from aacmm_pin.effects import probability, strongest_waves, values_in_words

FEW_WAVES = 4
"""So many waves of a free curve are listed."""
BY_MODEL = {
    "simulation": "nominal arm",
    "recalibrated": "recalibrated arm",
    "extended": "extended arm",
    "noise": "noise alone",
}


def diagnosis_line(diagnosis: Diagnosis) -> str:
    """Verdict, sizes of the residuals, causes, what is left, and the gain."""
    return "; ".join(_clauses(diagnosis))


def _clauses(diagnosis: Diagnosis) -> Iterator[str]:
    yield f"{diagnosis.verdict}; the RMS residual is {_sizes(diagnosis)}"
    yield from map(finding_line, diagnosis.findings)
    yield from map(str, diagnosis.unexplained.notes)
    yield from map(str, diagnosis.contradicted)
    if diagnosis.held_out is not None:
        yield _gain(diagnosis.held_out)
    if diagnosis.no_better:
        yield "the extended arm does not predict held-out records better than the recalibrated arm"


def _sizes(diagnosis: Diagnosis) -> str:
    words = BY_MODEL if diagnosis.extended.stated else BY_MODEL | {"noise": "estimated scatter"}
    each = [f"{size / MM:.4f} mm ({words[name]})" for name, size in diagnosis.rms.items()]
    return ", ".join(each)


def _gain(held: Gain) -> str:
    low, high = held.interval
    return f"the gain on held-out {held.kind} is {held.gain:.2f} ({low:.2f} to {high:.2f})"


def finding_line(finding: Finding) -> str:
    """Cause, place, probability and values."""
    said = [f"probability {probability(finding.probability)}", _values(finding)]
    return f"{finding.label} ({', '.join(filter(None, said))})"


def _values(finding: Finding) -> str:
    """Waves per turn of a free curve; the values of another cause."""
    waves = strongest_waves(finding.effect)
    if waves is None:
        return values_in_words(finding.effect, finding.parameters, finding.slides)
    sizes = [f"{order:.3g} ({size:.2g} rad)" for order, size in waves[:FEW_WAVES]]
    return f"waves per turn: {', '.join(sizes)}"
