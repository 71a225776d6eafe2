"""One set-up with its pool of records, and what a choice from it would tell together with the records that exist."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.calibration.parameters import Target, problem_of
from aacmm_pin.calibration.problem import Frame, Problem, registered
from aacmm_pin.calibration.stated_noise import StatedNoise, observations_of
from aacmm_pin.effects import Effect
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.measurements.records import Measurements
from aacmm_pin.planning.candidate_records import Postures, candidates
from aacmm_pin.planning.causes import identity
from aacmm_pin.planning.detection_power import triangle
from aacmm_pin.planning.information_rows import Layout, Rows, rows_of
from aacmm_pin.planning.setups import SetUp

LOOSE = 1e-6
"""A cause of which nobody knows anything is within a thousand times its typical size: information in that unit."""


@dataclass(frozen=True, eq=False)
class Asked:
    """What a plan is for.

    Attributes:
        model: the arm.
        causes: causes to tell apart, all parameters zero.
        existing: records that will be judged together with the new ones.
        target, external, prior: as in a calibration.
        noise: of readings, references, contacts, bars, complete.
    """

    model: ErrorModel
    causes: tuple[Effect, ...]
    existing: Measurements | None
    target: Target
    external: bool
    prior: bool
    noise: StatedNoise

    def problem(self, model: ErrorModel, records: Measurements) -> Problem:
        """Geometry and the causes unknown; effects of the model that are no such causes stay."""
        asked = {identity(effect) for effect in self.causes}
        rest = ErrorModel(model.arm, tuple(e for e in model.effects if identity(e) not in asked))
        return problem_of(
            rest,
            records,
            ["geometry", *self.causes],
            prior=self.prior,
            target=self.target,
            external=self.external,
        )

    @cached_property
    def frame(self) -> Frame:
        """Where the base is in the frame of the references, as far as the existing records say."""
        if not self.external or self.existing is None or self.existing.known.sum() < 3:
            return Frame.identity()
        known = self.existing.take(self.existing.known)
        return registered(self.model.predict(known.q, known.conditions), known.reference)


@dataclass(frozen=True, eq=False)
class Situation:
    """A set-up and its pool.

    Attributes:
        set_up: how the arm stands.
        pool: records that could be taken.
        layout: the unknowns.
        known: rows of what is there already: priors, stated seats, existing records (m, width).
        rows: of the pool.
        before: number of existing records among the known rows.
    """

    set_up: SetUp
    pool: Measurements
    layout: Layout
    known: Array
    rows: Rows
    before: int

    @staticmethod
    def of(asked: Asked, set_up: SetUp, postures: Postures, rng: np.random.Generator) -> Situation:
        """The rows of everything in this set-up; another arm file is measured and judged by itself."""
        existing = None if set_up.changes_arm else asked.existing
        pool = candidates(postures, set_up, asked.causes, asked.existing, rng)
        first = asked.problem(set_up.model, pool if existing is None else existing)
        seats = _labels(pool, asked.noise) | (set() if existing is None else _labels(existing, asked.noise))
        layout = Layout.of(first, asked.causes, tuple(sorted(seats)))
        known = [layout.prior()]
        stated: tuple[str, ...] = ()
        if existing is not None:
            old = rows_of(first, layout, asked.noise, asked.frame)
            known += [old.records.reshape(-1, layout.width), old.ties]
            stated = tuple(_labels(existing, asked.noise))
        if asked.external and postures.seat is None:
            pool = replace(pool, reference=asked.frame.apply(pool.reference))
        rows = rows_of(first.of(pool), layout, asked.noise, asked.frame, stated)
        return Situation(set_up, pool, layout, np.vstack([*known, rows.ties]), rows, 0 if existing is None else existing.n)

    @property
    def start(self) -> Array:
        """Information of what is known, with next to nothing about each cause (width, width)."""
        causes = np.zeros(self.layout.width)
        causes[self.layout.nuisances :] = LOOSE
        return np.asarray(self.known.T @ self.known + np.diag(causes))

    def triangle(self, chosen: list[int] | None, times: float = 1.0) -> Array:
        """What a choice (None: the whole pool), taken so many ``times``, tells of the causes; see :func:`power.triangle`."""
        new = self.rows.records if chosen is None else self.rows.records[chosen]
        new = np.sqrt(times) * new
        return triangle(np.vstack([self.known, new.reshape(-1, self.layout.width)]), self.layout.nuisances)


def _labels(records: Measurements, noise: StatedNoise) -> set[str]:
    return set(observations_of(records, noise, 0.0).labels)
