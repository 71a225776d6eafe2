"""The parameters of several effects as one vector, and their columns for one set of records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from aacmm_pin._support.arrays import Array, Index, Mask, cross
from aacmm_pin.arm import Arm, Parameter
from aacmm_pin.effects import (
    Displacement,
    Effect,
    JointDistance,
    JointPlacement,
    JointZeroOffset,
    LinkLength,
    LinkTwist,
    ReferenceFrame,
    SlideAngle,
    State,
    point_sensitivity,
    sensitivity,
    static_equilibrium,
)

DH_KIND_OF_EFFECT: dict[type[Effect], str] = {
    LinkLength: "a",
    JointDistance: "d",
    LinkTwist: "alpha",
    JointZeroOffset: "theta_offset",
    SlideAngle: "theta_offset",
}
Twists = dict[int, Array]
"""Of frames, by number (n or 1, 6)."""


def geometric_parameters(arm: Arm, effect: Effect) -> list[Parameter]:
    """The arm's parameters that an effect changes, in the order of its terms."""
    if isinstance(effect, JointPlacement):
        return [p for p in arm.parameters if p.joint == effect.joint]
    kind = DH_KIND_OF_EFFECT.get(type(effect))
    if kind is None:
        return []
    return [p for p in arm.parameters if p.kind == kind and p.joint == effect.row]


@dataclass(frozen=True, eq=False)
class ParameterVector:
    """Parameters of effects, one after the other. Iteration gives each effect and its slice.

    Attributes:
        effects: with the values where an estimation starts.
    """

    arm: Arm
    effects: tuple[Effect, ...]

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The entries of each effect."""
        ends = accumulate((len(effect.terms) for effect in self.effects), initial=0)
        return tuple(slice(*pair) for pair in pairwise(ends))

    def __iter__(self) -> Iterator[tuple[Effect, slice]]:
        return zip(self.effects, self.slices, strict=True)

    def of_sessions(self) -> Iterator[tuple[str, slice]]:
        """Sessions with unknown frames of references, and their entries."""
        for effect, entries in self:
            if isinstance(effect, ReferenceFrame) and effect.session is not None:
                yield effect.session, entries

    @property
    def size(self) -> int:
        """Number of entries p."""
        return self.slices[-1].stop if self.slices else 0

    @cached_property
    def values(self) -> Array:
        """Values of the effects (p,) [their units]."""
        return np.array([value for effect in self.effects for value in effect.values])

    @cached_property
    def typical(self) -> Array:
        """Typical magnitude of each entry (p,) [their units]."""
        typical = []
        for effect in self.effects:
            typical += [term.typical for term in effect.terms]
        return np.array(typical)

    @cached_property
    def arm_parameters(self) -> tuple[Parameter | None, ...]:
        """The arm's parameter that each entry changes; None if it is not geometric."""
        parameters: list[Parameter | None] = []
        for effect in self.effects:
            parameters += geometric_parameters(self.arm, effect) or [None] * len(effect.terms)
        return tuple(parameters)

    @property
    def geometric(self) -> Mask:
        """Whether an entry changes a parameter of the arm (p,)."""
        return np.array([p is not None for p in self.arm_parameters], dtype=bool)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Of each entry; geometric ones by the arm's names."""
        parameters: list[Parameter] = []
        for effect in self.effects:
            parameters += effect.parameters()
        for k, arm_parameter in enumerate(self.arm_parameters):
            if arm_parameter is not None:
                parameters[k] = replace(parameters[k], name=arm_parameter.name)
        return tuple(parameters)

    @property
    def names(self) -> list[str]:
        """Name of each entry."""
        return [parameter.name for parameter in self.parameters]

    @property
    def stated_values(self) -> Array:
        """The arm's values, to which the effects' add (p,); 0 if not geometric."""
        return np.array([0.0 if p is None else p.value for p in self.arm_parameters])

    @cached_property
    def stated_u(self) -> Array:
        """Standard uncertainties of the arm's values (p,); 0 if not geometric."""
        return np.array([0.0 if p is None else p.u for p in self.arm_parameters])

    def at(self, x: Array) -> tuple[Effect, ...]:
        """The effects with values ``x`` (p,)."""
        return tuple(effect.at(x[entries]) for effect, entries in self)


@dataclass(frozen=True, eq=False)
class _ConstantTwists:
    """Parameters with one twist in all records: frames (k,), twists (k, 6), and numbers of the
    parameters (k,).
    """

    frame: Index
    twist: Array
    number: Index
    of_reference: Mask


@dataclass(frozen=True, eq=False)
class _VaryingTwists:
    """Twists of one frame per unit in each record (n, 6, k), and numbers of the parameters."""

    displacement: Displacement
    number: slice
    of_reference: bool
    is_linear: bool


@dataclass(frozen=True, eq=False)
class Columns:
    """Many effects at once on the records of one arm, several times faster than one by one.

    What does not depend on the arm's position is computed once: a geometric value has one twist in
    all records, an encoder error or thermal length the same in every step. Only elastic effects
    change.

    Attributes:
        state: of the nominal arm.
        given: other effects, with constant values.
    """

    state: State
    vector: ParameterVector
    constant: _ConstantTwists
    varying: tuple[_VaryingTwists, ...]
    given: tuple[Effect, ...]

    @staticmethod
    def of(state: State, effects: Iterable[Effect], given: Iterable[Effect] = ()) -> Columns:
        """From the nominal arm in its records."""
        vector = ParameterVector(state.arm, tuple(effects))
        varying = []
        frames = []
        twists: list[Array] = []
        numbers: list[int] = []
        of_reference: list[bool] = []
        for effect, entries in vector:
            is_linear = type(effect).exact is Effect.exact
            displacements = [] if effect.elastic else effect.displacements(state)
            for d in displacements:
                if not (len(displacements) == len(d.columns) == 1 and is_linear):
                    varying.append(_VaryingTwists(d, entries, effect.of_reference, is_linear))
                    continue
                width = entries.stop - entries.start
                frames += width * [d.place]
                twists.append(d.columns[0].T)
                numbers += range(entries.start, entries.stop)
                of_reference += width * [effect.of_reference]
        constant = _ConstantTwists(
            np.array(frames, dtype=np.intp),
            np.concatenate([np.zeros((0, 6)), *twists]),
            np.array(numbers, dtype=np.intp),
            np.array(of_reference, dtype=bool),
        )
        acting = tuple(effect for effect in given if any(effect.values))
        return Columns(state, vector, constant, tuple(varying), acting)

    @cached_property
    def _given_twists(self) -> tuple[Twists, Twists]:
        """Of the arm, and of the references, by the given effects that are not elastic."""
        of_arm: Twists = {}
        of_references: Twists = {}
        for effect in self.given:
            twists = of_references if effect.of_reference else of_arm
            for frame, twist in [] if effect.elastic else effect.exact(self.state):
                _add(twists, {frame: twist})
        return of_arm, of_references

    @cached_property
    def _elastic(self) -> list[tuple[Effect, slice]]:
        return [(effect, entries) for effect, entries in self.vector if effect.elastic]

    @cached_property
    def _constant_twists(self) -> list[tuple[list[int], Array]]:
        """Numbers of frames, and their twists by one unit of each parameter (frames, 6, p): of the
        arm, of the references.
        """
        constant = self.constant
        twists = []
        for chosen in (~constant.of_reference, constant.of_reference):
            frames, position = np.unique(constant.frame[chosen], return_inverse=True)
            per_unit = np.zeros((frames.size, 6, self.vector.size))
            per_unit[position, :, constant.number[chosen]] = constant.twist[chosen]
            twists.append((frames.tolist(), per_unit))
        return twists

    def at(self, x: Array) -> State:
        """The arm with all effects, at the values ``x`` (p,)."""
        state = replace(self.state, twists=self._twists(x, of_reference=False))
        elastic = [effect for effect in self.given if effect.elastic]
        elastic += [effect.at(x[entries]) for effect, entries in self._elastic if x[entries].any()]
        state = static_equilibrium(elastic, state)
        errors_of_references = self._twists(x, of_reference=True)
        if not errors_of_references:
            return state
        # They come last, for they do not turn the arm against gravity.
        twists = dict(state.twists)
        _add(twists, errors_of_references)
        return replace(state, twists=twists)

    def jacobian(self, state: State, more: int = 0) -> Array:
        """:func:`aacmm_pin.effects.sensitivity` of all p parameters in ``state``, and ``more`` zero
        columns (n, 3 or 6, p + more); records are last in memory.
        """
        shape = (state.coordinates, self.vector.size + more, state.n)
        columns = np.zeros(shape).transpose(2, 0, 1)
        if self.constant.frame.size:
            columns[:, :, self.constant.number] = self._constant_columns(state)
        for part in self.varying:
            columns[:, :, part.number] += point_sensitivity(state, part.displacement)
        for effect, entries in self._elastic:
            columns[:, :, entries] = sensitivity(effect, state)
        return columns

    def _constant_columns(self, state: State) -> Array:
        """``R v + (R ω) × (p - o)`` (n, 3, k); behind it rotations ``R ω``."""
        frame = self.constant.frame
        axes = state.rotation.transpose(0, 3, 2, 1)[frame].reshape(-1, 3, 3 * state.n)
        twists = (self.constant.twist.reshape(-1, 2, 3) @ axes).reshape(-1, 2, 3, state.n)
        lever = state.position.T - state.origin.transpose(0, 2, 1)[frame]
        turns = twists[:, 1]
        motions = twists[:, 0] + cross(turns, lever)
        if state.with_rotation:
            motions = np.concatenate([motions, turns], axis=1)
        return motions.transpose(2, 1, 0)

    def _twists(self, x: Array, of_reference: bool) -> Twists:
        frames, per_unit = self._constant_twists[of_reference]
        twists = dict(self._given_twists[of_reference])
        _add(twists, dict(zip(frames, (per_unit @ x)[:, None], strict=True)))
        for part in self.varying:
            if part.of_reference == of_reference and part.is_linear and x[part.number].any():
                _add(twists, {part.displacement.place: part.displacement.columns @ x[part.number]})
        for effect, entries in self.vector:
            has_own_exact = not effect.elastic and type(effect).exact is not Effect.exact
            if has_own_exact and effect.of_reference == of_reference and x[entries].any():
                for frame, twist in effect.at(x[entries]).exact(self.state):
                    _add(twists, {frame: twist})
        return twists


def _add(twists: Twists, more: Twists) -> None:
    for frame, twist in more.items():
        twists[frame] = twists[frame] + twist if frame in twists else twist
