"""The first section of the page: the questions that it answers, each with its answer in a sentence."""

from __future__ import annotations

from typing import Any

from aacmm_pin._support.units import MM, UM
from aacmm_pin.report.demo.study import Study
from aacmm_pin.report.diagnosis_findings import gain_in_words, in_words, several_in_words
from aacmm_pin.report.html import Bullets, Part


def in_short(study: Study, summary: dict[str, Any]) -> list[Part]:
    """What the page is about, and what it found.

    Args:
        study: all that was worked out.
        summary: accuracy at the working point, see :func:`aacmm_pin.report.summaries.accuracy_summary`.
    """
    arm = study.arm.name
    return [
        f"Before measuring: at this point, in which posture, how accurate is {arm}, and why? After measuring: what does its "
        "model get wrong, what causes it, and how much better is the arm once the model knows?",
        Bullets([_postures(study), _accuracy(study, summary), _workspace(study), _hidden(study)]),
    ]


def _postures(study: Study) -> str:
    circle = study.circle
    x, y, z = circle.point / MM
    return (
        f"Postures: {len(circle)} configurations of {int(circle.component.max())} closed curves were sampled that bring the "
        f"wrist to ({x:.1f}, {y:.1f}, {z:.1f}) mm; {int(circle.within_limits.sum())} of them are within the joint limits."
    )


def _accuracy(study: Study, summary: dict[str, Any]) -> str:
    volume, u = summary["volume_mm3"], study.accuracy.u / UM
    sources = study.accuracy.budget().head(2).to_dict("records")
    largest = " and ".join(f"{row['parameter']} ({100 * row['share']:.0f} %)" for row in sources)
    return (
        f"Accuracy there: the posture decides whether the accuracy volume is {volume['min']:.4f} or {volume['max']:.4f} mm³ "
        f"and the standard uncertainty {u.min():.0f} or {u.max():.0f} µm. Most of the variance comes from {largest}."
    )


def _workspace(study: Study) -> str:
    counts = study.map.working_sectors()
    return (
        f"Over the workspace: {counts[study.map.sectors]} of {sum(counts.values())} reachable cells of the map are reached "
        "all round the circle."
    )


def _hidden(study: Study) -> str:
    hidden = study.hidden
    found = several_in_words([finding.effect for finding in hidden.found.findings]) or "nothing"
    return (
        "After measuring, with records simulated for this page: what was hidden in them is "
        f"{in_words(hidden.effect)}; what was found is {found}. {gain_in_words(hidden.found)}"
    )
