"""Draws of what is uncertain in an arm, as causes of error whose values differ from draw to draw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aacmm_pin._support.checks import Array
from aacmm_pin.effects import Displacement, Effect, Term
from aacmm_pin.effects.error_model import ErrorModel
from aacmm_pin.effects.geometry import of_geometry
from aacmm_pin.effects.state import State


def parameter_errors(model: ErrorModel, rng: np.random.Generator, count: int) -> Array:
    """Drawn errors of all parameters of a model: (count, p) [their units], in the order of ``model.parameters``.

    Parameters that the arm file's covariance names are normal and drawn together (JCGM 101:2008, 6.4.8); other parameters
    with bounds are rectangular (6.4.2), the rest normal and independent (6.4.7).
    """
    parameters, known = model.parameters, model.arm.covariance
    together = () if known is None else known.parameters
    bounded = np.array([p.half_width is not None and p.name not in together for p in parameters])
    covariance = model.covariance()
    u = np.sqrt(np.diag(covariance))
    half_width = np.array([p.half_width or 0.0 for p in parameters])
    errors = np.zeros((count, len(parameters)))
    errors[:, bounded] = rng.uniform(-1.0, 1.0, size=(count, int(bounded.sum()))) * half_width[bounded]
    normal = np.flatnonzero(~bounded & (u > 0))
    correlation = covariance[np.ix_(normal, normal)] / np.outer(u[normal], u[normal])
    variance, direction = np.linalg.eigh(correlation)
    # A correlation matrix that was rounded in a file may have eigenvalues a little below zero: they are zero.
    root = direction * np.sqrt(np.maximum(variance, 0.0))
    errors[:, normal] = rng.normal(size=(count, len(normal))) @ root.T * u[normal]
    return errors


def drawn_effects(model: ErrorModel, errors: Array) -> tuple[Effect, ...]:
    """The arm's own parameters and its effects as causes whose values differ from record to record by ``errors`` (n, p)."""
    causes = [*of_geometry(model.arm), *model.effects]
    ends = np.cumsum([len(cause.terms) for cause in causes])
    own = zip(causes, np.split(errors, ends[:-1], axis=1), strict=True)
    return tuple(_drawn(cause, error) if error.any() else cause for cause, error in own if not cause.of_reference)


def _drawn(cause: Effect, error: Array) -> Effect:
    kind = _DrawnElastic if cause.elastic else _Drawn
    return kind(of=cause, drawn=np.array(cause.values) + error)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Drawn(Effect):
    """A cause with other values in every record: its one parameter is the share of them that acts, 1.

    Attributes:
        of: the cause.
        drawn: values of its parameters in each record (n, p).
    """

    of: Effect
    drawn: Array
    values: tuple[float, ...] = (1.0,)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The share."""
        return (Term("share", "1", 1.0, "share"),)

    @property
    def label(self) -> str:
        """That of the cause."""
        return self.of.label

    def displacements(self, state: State) -> list[Displacement]:
        """Those of the cause, times the values of each record."""
        if type(self.of).exact is not Effect.exact:
            return [Displacement(place, twist[:, :, None]) for place, twist in self._one_by_one(state)]
        columns = [
            (d.place, np.broadcast_to(d.columns, (state.n, *d.columns.shape[1:]))) for d in self.of.displacements(state)
        ]
        return [Displacement(place, np.einsum("nip,np->ni", c, self.drawn)[:, :, None]) for place, c in columns]

    def _one_by_one(self, state: State) -> list[tuple[int, Array]]:
        """Exact twists of a cause that is not linear in its values."""
        each = []
        for k, values in enumerate(self.drawn):
            twists = {p: t if len(t) == 1 else t[k : k + 1] for p, t in state.twists.items()}
            own = State(state.arm, state.q[k : k + 1], state.conditions.take([k]), state.target, twists)
            each.append(self.of.at(values).exact(own))
        return [(same[0][0], np.concatenate([twist for _, twist in same])) for same in zip(*each, strict=True)]


class _DrawnElastic(_Drawn):
    """The same of a cause that depends on how the arm is bent."""

    elastic = True
