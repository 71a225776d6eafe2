"""Many effects at once for one set of records, several times faster than one by one.

What does not depend on the arm's position is computed once: a geometric value has one twist in all
records, an encoder error or thermal length the same in every step. Only elastic effects change.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aacmm_pin._support.batches import cross
from aacmm_pin._support.checks import Array, Index, Mask
from aacmm_pin.calibration.parameter_vector import ParameterVector
from aacmm_pin.effects import (
    Displacement,
    Effect,
    State,
    point_sensitivity,
    sensitivity,
    static_equilibrium,
)

Twists = dict[int, Array]


@dataclass(frozen=True, eq=False)
class _Same:
    """Parameters with the same twist in every record: places (k,), twists (k, 6), numbers (k,)."""

    place: Index
    twist: Array
    number: Index
    of_reference: Mask


@dataclass(frozen=True, eq=False)
class _Varying:
    """One place, twists per unit in each record (n, 6, k), and numbers of the parameters."""

    displacement: Displacement
    number: slice
    of_reference: bool
    straight: bool


@dataclass(frozen=True, eq=False)
class Columns:
    """Effects on the records of one arm.

    Attributes:
        state: of the nominal arm.
        given: other effects, with constant values.
    """

    state: State
    vector: ParameterVector
    same: _Same
    varying: tuple[_Varying, ...]
    given: tuple[Effect, ...]

    @staticmethod
    def of(state: State, effects: Iterable[Effect], given: Iterable[Effect] = ()) -> Columns:
        """From the nominal arm in its records."""
        vector = ParameterVector(state.arm, tuple(effects))
        varying = []
        places = []
        twists: list[Array] = []
        numbers: list[int] = []
        of_reference: list[bool] = []
        for effect, entries in vector:
            straight = type(effect).exact is Effect.exact
            displacements = [] if effect.elastic else effect.displacements(state)
            for d in displacements:
                if not (len(displacements) == len(d.columns) == 1 and straight):
                    varying.append(_Varying(d, entries, effect.of_reference, straight))
                    continue
                width = entries.stop - entries.start
                places += width * [d.place]
                twists.append(d.columns[0].T)
                numbers += range(entries.start, entries.stop)
                of_reference += width * [effect.of_reference]
        same = _Same(
            np.array(places, dtype=np.intp),
            np.concatenate([np.zeros((0, 6)), *twists]),
            np.array(numbers, dtype=np.intp),
            np.array(of_reference, dtype=bool),
        )
        acting = tuple(effect for effect in given if any(effect.values))
        return Columns(state, vector, same, tuple(varying), acting)

    @cached_property
    def _given_twists(self) -> tuple[Twists, Twists]:
        """Of the arm, and of the references."""
        twists: tuple[Twists, Twists] = ({}, {})
        for effect in self.given:
            for place, twist in [] if effect.elastic else effect.exact(self.state):
                _sum(twists[effect.of_reference], {place: twist})
        return twists

    @cached_property
    def _elastic(self) -> list[tuple[Effect, slice]]:
        return [(effect, entries) for effect, entries in self.vector if effect.elastic]

    @cached_property
    def _same_twists(self) -> list[tuple[list[int], Array]]:
        """Places and twists by one unit of each parameter (places, 6, p): of the arm, of the
        references.
        """
        twists = []
        for chosen in (~self.same.of_reference, self.same.of_reference):
            places, at = np.unique(self.same.place[chosen], return_inverse=True)
            per_unit = np.zeros((places.size, 6, self.vector.size))
            per_unit[at, :, self.same.number[chosen]] = self.same.twist[chosen]
            twists.append((places.tolist(), per_unit))
        return twists

    def at(self, x: Array) -> State:
        """The arm with all effects, at the values ``x`` (p,)."""
        state = replace(self.state, twists=self._twists(x, False))
        elastic = [effect for effect in self.given if effect.elastic]
        elastic += [effect.at(x[entries]) for effect, entries in self._elastic if x[entries].any()]
        state = static_equilibrium(elastic, state)
        of_reference = self._twists(x, True)
        if not of_reference:
            return state
        return replace(state, twists=_sum(dict(state.twists), of_reference))

    def jacobian(self, state: State, more: int = 0) -> Array:
        """:func:`aacmm_pin.effects.sensitivity` of all parameters in ``state``, and ``more`` zero
        columns.
        """
        total = np.zeros((state.coordinates, self.vector.size + more, state.n)).transpose(2, 0, 1)
        if self.same.place.size:
            total[:, :, self.same.number] = self._same_columns(state)
        for part in self.varying:
            total[:, :, part.number] += point_sensitivity(state, part.displacement)
        for effect, entries in self._elastic:
            total[:, :, entries] = sensitivity(effect, state)
        return total

    def _same_columns(self, state: State) -> Array:
        """``R v + (R ω) × (p - o)`` (n, 3, k); behind it turns ``R ω``."""
        place = self.same.place
        axes = state.rotation.transpose(0, 3, 2, 1)[place].reshape(-1, 3, 3 * state.n)
        moves = (self.same.twist.reshape(-1, 2, 3) @ axes).reshape(-1, 2, 3, state.n)
        lever = state.position.T - state.origin.transpose(0, 2, 1)[place]
        turns = moves[:, 1]
        motions = moves[:, 0] + cross(turns, lever)
        if state.with_rotation:
            motions = np.concatenate([motions, turns], axis=1)
        return motions.transpose(2, 1, 0)

    def _twists(self, x: Array, of_reference: bool) -> Twists:
        places, per_unit = self._same_twists[of_reference]
        twists = dict(self._given_twists[of_reference])
        _sum(twists, dict(zip(places, (per_unit @ x)[:, None], strict=True)))
        for part in self.varying:
            if part.of_reference == of_reference and part.straight and x[part.number].any():
                _sum(twists, {part.displacement.place: part.displacement.columns @ x[part.number]})
        for effect, entries in self.vector:
            is_linear = effect.elastic or type(effect).exact is Effect.exact
            if not is_linear and effect.of_reference == of_reference and x[entries].any():
                for place, twist in effect.at(x[entries]).exact(self.state):
                    _sum(twists, {place: twist})
        return twists


def _sum(twists: Twists, more: Twists) -> Twists:
    for place, twist in more.items():
        twists[place] = twists[place] + twist if place in twists else twist
    return twists
