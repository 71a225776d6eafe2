"""Plan records that distinguish similar causes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import whole
from aacmm_pin._support.display import Note
from aacmm_pin._support.progress import Progress, watched
from aacmm_pin.calibration import ReferenceFrame, Setup, Target
from aacmm_pin.effects import Effect, ErrorModel, GivenCause, GivenModel, as_causes
from aacmm_pin.errors import AacmmError, UnknownNameError
from aacmm_pin.measurements import (
    ENCODER,
    REFERENCE_NOISE,
    GivenRecords,
    Measurements,
    as_measurements,
    seed_of,
)
from aacmm_pin.planning.candidate_records import free_postures, postures_at_seats
from aacmm_pin.planning.discrimination import for_all, for_two
from aacmm_pin.planning.measurement_plan import MeasurementPlan
from aacmm_pin.planning.task import Task, require_separable, usual_causes

PlannedScheme = Literal["free", "seats"]
POOL_SIZE = 2000
"""Postures to choose from."""


def plan_measurements(
    model: GivenModel,
    split: tuple[GivenCause, GivenCause] | None = None,
    records: int = 40,
    *,
    existing: GivenRecords | None = None,
    scheme: PlannedScheme = "free",
    reference_frame: ReferenceFrame = "base",
    target: Target = "tip",
    prior: bool = True,
    encoder_noise: ArrayLike | None = None,
    reference_noise: float | None = None,
    probe_noise: float | None = None,
    length_noise: float | None = None,
    above: float | None = None,
    as_it_stands: bool = False,
    postures: int = POOL_SIZE,
    rng: np.random.Generator | None = None,
    progress: Progress = True,
) -> MeasurementPlan:
    """Plan records that distinguish two causes, or all possible causes of the arm.

    For two causes k and l the plan maximises the smaller of ``T_kl`` and ``T_lk``, with ``T_kl =
    min over η, β_l of ‖G_k β_k - Z η - G_l β_l‖²`` (T-optimality: Atkinson, Fedorov 1975,
    Biometrika 62), whitened by the noise. Z is the sensitivity to what every fit estimates:
    geometry within its stated uncertainties, an unknown frame, and seats. β_k has the values of the
    cause or, if zero, the typical magnitude in any direction. Records are added one by one, then
    each is exchanged once. If postures do not suffice, the plan adds conditions of the causes
    (approach, temperature, warm-up), then a load, then another mount.

    Without ``split``, each record is the best for the pair distinguished worst so far; none is
    exchanged.

    Args:
        model: arm, perhaps with causes of error, which keep their values.
        split: two causes, or labels such as ``joint_compliance:2``; None for all.
        records: number to plan.
        existing: records to evaluate together with the new ones.
        scheme: ``free`` if each record gets coordinates (laser tracker); ``seats`` for existing or
            new seats.
        reference_frame, target, prior, encoder_noise, reference_noise, probe_noise, length_noise:
            see :func:`aacmm_pin.calibration.calibrate`. A note states an assumed noise.
        above: height of a table over the base origin, against gravity [m], above which the tip
            stays.
        as_it_stands: exclude a load and another mount.
        postures: available; fewer need less time.
        rng: default seed 1.
        progress: show a bar in a notebook or on stderr; or a function such as ``tqdm``.

    Raises:
        UnknownNameError: unknown cause, field, scheme or frame.
        MissingConditionError: existing records lack a condition that a cause needs.
        UnsupportedArmError: it lacks what a cause needs, such as masses.
        AacmmError: no plan can distinguish them, too few records or postures, or records of another
            arm.
    """
    model = ErrorModel.of(model).restricted_to_known_range()
    existing = None if existing is None else as_measurements(existing, model.arm)
    rng = rng or np.random.default_rng(1)
    seed = seed_of(rng)
    present = () if existing is None else existing.conditions.present
    wanted = as_causes(usual_causes(model) if split is None else split, model, present)
    causes, usable, left_out = _usable(wanted, existing, split is not None)
    require_separable(causes, model.arm)
    if scheme == "free" and (at_seat := next((e for e in causes if "seat" in e.needs), None)):
        raise AacmmError(
            f"{at_seat.label} has an effect only at this seat; expected the scheme 'seats' and "
            "existing records of this seat"
        )
    setup = Setup.of(
        model.arm,
        reference_frame,
        target,
        prior,
        encoder_noise,
        reference_noise,
        probe_noise,
        length_noise,
    )
    unknown = tuple(effect.at(()) for effect in causes)
    task, candidates, notes = prepared(
        model, unknown, usable, setup, scheme, records, postures, above, rng
    )
    with watched(range(records), progress, "plan", "record") as steps:
        if split is None:
            plan = for_all(task, candidates, records, rng, steps)
        else:
            pair = causes[0], causes[1]
            plan = for_two(task, pair, candidates, records, as_it_stands, rng, steps)
    if "torque" in present and split is not None:
        left_out += (Note("record_torques"),)
    return replace(plan, seed=seed, notes=(*notes, *left_out, *plan.notes))


def prepared(
    model: ErrorModel,
    causes: tuple[Effect, ...],
    existing: Measurements | None,
    setup: Setup,
    scheme: PlannedScheme,
    records: int,
    postures: int,
    above: float | None,
    rng: np.random.Generator,
) -> tuple[Task, Measurements, tuple[Note, ...]]:
    """The task with complete noise, postures to choose from, and notes on assumptions."""
    arm = model.arm
    if scheme not in get_args(PlannedScheme):
        raise UnknownNameError("scheme", scheme, list(get_args(PlannedScheme)))
    whole(records, 1, "records of a plan")
    whole(postures, 1, "postures")
    if postures < records:
        raise AacmmError(
            f"postures is {postures}; expected at least {records}, the number of records"
        )
    if existing is not None and existing.nq != arm.nq:
        raise AacmmError(
            f"{existing.source} has angles of {existing.nq} joints; expected {arm.nq}, as many as "
            f"{arm.name} has"
        )
    if setup.frame_of_session:
        raise AacmmError(
            "reference_frame is session; expected base or external, because planned records are of "
            "one session"
        )
    if existing is not None:  # a plan is of tips
        existing = replace(existing, orientation=None, orientation_u=None)
    notes = []
    if setup.encoder_noise is None:
        setup = replace(setup, encoder_noise=np.full(arm.nq, ENCODER))
        notes.append(Note("encoder_noise_assumed", {"noise": ENCODER}))
    if setup.reference_noise is None:
        setup = replace(setup, reference_noise=REFERENCE_NOISE)
        notes.append(Note("reference_noise_assumed", {"noise": REFERENCE_NOISE}))
    task = Task(model, causes, existing, replace(setup, probe_noise=setup.probe_noise or 0.0))
    if scheme == "free":
        candidates = free_postures(arm, postures, above, rng)
    else:
        candidates = postures_at_seats(task, postures, above, rng)
    if candidates.n < records:
        raise AacmmError(
            f"records is {records}; expected at most {candidates.n}, because the plan found only "
            "so many different postures"
        )
    return task, candidates, tuple(notes)


def _usable(
    causes: tuple[Effect, ...], existing: Measurements | None, named: bool
) -> tuple[tuple[Effect, ...], Measurements | None, tuple[Note, ...]]:
    """Causes and existing records that can be used together, and notes on others.

    If records lack a condition of a cause, a ``named`` cause counts and the records do not, else
    the reverse.
    """
    if existing is None:
        return causes, None, ()
    stated = set(existing.conditions.present)
    if "link_temperature" in stated:
        stated.add("temperature")
    lacking = [effect for effect in causes if not stated.issuperset(effect.needs)]
    if not lacking:
        return causes, existing, ()
    needs: set[str] = set()
    for effect in lacking:
        of_cause = f" ({effect.label})" if named else ""
        needs |= {need + of_cause for need in effect.needs if need not in stated}
    data: dict[str, Any] = {"source": existing.source, "needs": sorted(needs)}
    if named:
        return causes, None, (Note("records_not_counted", data),)
    data["causes"] = [*dict.fromkeys(effect.label for effect in lacking)]
    usable = tuple(effect for effect in causes if effect not in lacking)
    return usable, existing, (Note("causes_left_out", data),)
