"""A diagnosis, and a cause, in one line."""

from __future__ import annotations

from aacmm_pin._support.units import MM
from aacmm_pin.diagnosis import Diagnosis, Finding
from aacmm_pin.effects import probability, strongest_waves, values_in_words

FEW_WAVES = 4
"""Waves of an error curve to list."""


def diagnosis_line(diagnosis: Diagnosis) -> str:
    """Verdict, sizes of the residuals, causes, remaining structure, and gain."""
    names = {name: f"{name} arm" for name in diagnosis.rms}
    names["noise"] = "noise alone" if diagnosis.extended.noise_is_stated else "estimated scatter"
    residuals = ", ".join(
        f"{size / MM:.4f} mm ({names[name]})" for name, size in diagnosis.rms.items()
    )
    clauses = [
        f"{diagnosis.verdict}; the RMS residual is {residuals}",
        *map(finding_line, diagnosis.findings),
        *map(str, diagnosis.unexplained.notes),
        *map(str, diagnosis.contradicted),
    ]
    held = diagnosis.held_out
    if held is not None:
        low, high = held.interval
        gain = f"{held.gain:.2f} ({low:.2f} to {high:.2f})"
        clauses.append(f"the gain on held-out {held.kind} is {gain}")
    if diagnosis.no_better:
        clauses.append(
            "the extended arm does not predict held-out records better than the recalibrated arm"
        )
    return "; ".join(clauses)


def finding_line(finding: Finding) -> str:
    """Cause, place, probability and values; waves per turn of an error curve."""
    waves = strongest_waves(finding.effect)
    if waves is None:
        values = values_in_words(finding.effect, finding.parameters, finding.slides)
    else:
        sizes = [f"{order:.3g} ({size:.2g} rad)" for order, size in waves[:FEW_WAVES]]
        values = f"waves per turn: {', '.join(sizes)}"
    words = filter(None, [f"probability {probability(finding.probability)}", values])
    return f"{finding.label} ({', '.join(words)})"
