"""The causes of the library that a set of records can show."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from aacmm_pin.arm import Arm
from aacmm_pin.calibration import Problem, Setup
from aacmm_pin.calibration.parameters import is_reestimated
from aacmm_pin.effects import (
    CAUSES,
    Discrepancy,
    Effect,
    ErrorModel,
    ReferenceFrame,
    StylusOffset,
    all_candidates,
    load_variants,
    of_geometry,
    require_row,
)
from aacmm_pin.errors import UnknownNameError
from aacmm_pin.measurements import Measurements

Variants = tuple[Effect, ...]
"""A candidate: one cause at one place with each nonlinear value, all linear parameters zero."""


def is_change(effect: Effect) -> bool:
    """Whether a variant is the change of a known cause, whose stated u it has."""
    return any(effect.u)


def candidates(
    model: ErrorModel, measurements: Measurements, problem: Problem, extra: Sequence[Effect] = ()
) -> list[Variants]:
    """Every registered cause that these records could show, one for each place.

    Args:
        model: the arm. The change of a known cause is a candidate with its stated u; its other
            variants have another nonlinear parameter and replace it, or are of a load that the
            arm's file does not have.
        problem: what is refitted anyway; geometric values beyond what is stated of them are causes
            too.
        extra: more causes; those with one label are variants of one candidate.

    Raises:
        UnknownNameError: an extra cause is not registered.
        AacmmError: an extra cause is on a row that the arm does not have.
    """
    set_up_variants = [(effect,) for effect in _of_set_up(model.arm, measurements, problem)]
    library = [*all_candidates(model.arm, measurements), *set_up_variants]
    by_label = {variants[0].label: variants for variants in library}
    for effect in extra:
        if CAUSES.get(effect.cause) is not type(effect):
            raise UnknownNameError(
                "cause",
                effect.cause,
                list(CAUSES),
                "for your own cause, call aacmm_pin.effects.register",
            )
        label = require_row(effect, model.arm).label
        variants = (*by_label.get(label, ()), effect.at(()))
        by_label[label] = tuple(dict.fromkeys(variants))
    changes = [*_changes(model, measurements, problem.setup, by_label)]
    for effect in model.effects:
        if getattr(effect, "load_at", None) is None:  # at another load the cause may act too
            by_label.pop(effect.label, None)
    return [*changes, *by_label.values()]


def _changes(
    model: ErrorModel, measurements: Measurements, setup: Setup, by_label: Mapping[str, Variants]
) -> Iterator[Variants]:
    """The change of each known cause, which has its stated u, and its other variants, from
    ``by_label`` or of another load; the first known cause of a label has them.
    """
    identities_taken = {effect.identity for effect in model.effects}
    for effect in known_causes(model, measurements, setup):
        other_variants = [*load_variants(effect, model.arm)]
        if effect.nonlinear.field:
            other_variants = [*by_label.get(effect.label, ()), *other_variants]
        new_variants = [
            variant for variant in other_variants if variant.identity not in identities_taken
        ]
        identities_taken.update(variant.identity for variant in new_variants)
        yield (effect.at((), effect.u), *new_variants)


def not_tried(
    arm: Arm, library: Sequence[Variants], measurements: Measurements
) -> dict[str, tuple[type[Effect], ...]]:
    """Conditions that the records do not state, each with the causes that need it; without those of
    the whole arm that this arm cannot have.
    """
    causes_tried = {variants[0].cause for variants in library}
    causes_by_condition = defaultdict[str, tuple[type[Effect], ...]](tuple)
    for cause in CAUSES.values():
        needs = getattr(cause, "needs", ())
        if cause.cause in causes_tried or not isinstance(needs, tuple):  # depends on its fields
            continue
        missing = [need for need in needs if getattr(measurements.conditions, need) is None]
        if missing and (cause.location_field() is not None or any(cause.candidates(arm))):
            causes_by_condition[missing[0]] += (cause,)
    return causes_by_condition


def known_causes(model: ErrorModel, measurements: Measurements, setup: Setup) -> list[Effect]:
    """The causes of the arm with a stated uncertainty that counts, without discrepancies."""
    if not setup.prior:
        return []
    return [
        effect
        for effect in model.effects
        if any(effect.u)
        and not isinstance(effect, Discrepancy)
        and not is_reestimated(effect, setup, measurements)
    ]


def _of_set_up(arm: Arm, measurements: Measurements, problem: Problem) -> Iterator[Effect]:
    """Geometric values beyond what is stated; a tip or frame of references elsewhere than
    stated.
    """
    vector = problem.vector
    labels_estimated = {effect.label for effect in vector.effects}
    for effect, entries in vector:
        if problem.stated[entries].all() and vector.arm_parameters[entries.start] is not None:
            yield effect.at(())
    if arm.dh is not None:
        yield from (effect for effect in of_geometry(arm) if effect.label not in labels_estimated)
    if not any(isinstance(effect, StylusOffset) for effect in vector.effects):
        yield StylusOffset()
    if measurements.known.any() and not problem.external:
        yield ReferenceFrame()
