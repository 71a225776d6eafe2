"""An arm with causes of error: prediction, sensitivity, correction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from aacmm_pin._support.arrays import Array, Mask, batch
from aacmm_pin._support.display import Note, Shown
from aacmm_pin.arm import (
    AT_LIMIT,
    Arm,
    ArmFile,
    GivenArm,
    Parameter,
    UrdfArmFile,
    arm_text,
    as_arm,
    validated,
    whole_turn_notes,
)
from aacmm_pin.effects.conditions import CONDITION_COLUMNS, Conditions
from aacmm_pin.effects.effect import (
    Effect,
    TimeConstant,
    axis,
    extra_uncertainty_effects,
    sensitivity,
)
from aacmm_pin.effects.geometry import of_geometry
from aacmm_pin.effects.labels import known_range_in_words
from aacmm_pin.effects.state import State
from aacmm_pin.errors import AacmmError, ArmFileError, ShapeError, UnknownNameError

MOST_EQUILIBRIUM_STEPS = 20
"""Three or four suffice."""
SAME_TWIST = 1e-15
"""[m, rad]"""


@dataclass(frozen=True, eq=False, init=False)
class ErrorModel(Shown):
    """An arm with causes of error.

    Attributes:
        arm: the arm, with the covariance of its file.
        effects: causes with the values of their parameters.
    """

    arm: Arm
    effects: tuple[Effect, ...]

    def __init__(self, arm: GivenArm, effects: GivenCause | Iterable[GivenCause] = ()) -> None:
        """Make a model from an arm, its name or its path, and from causes or their texts.

        Causes in the arm file are ignored; :meth:`load` includes them.

        Raises:
            UnknownNameError: a name or cause is unknown, or the covariance has an unknown
                parameter.
            AacmmError: two causes have the same parameter.
        """
        object.__setattr__(self, "arm", as_arm(arm))
        object.__setattr__(self, "effects", ())  # a text of a cause takes defaults from the model
        object.__setattr__(self, "effects", as_causes(effects, self))
        names = [parameter.name for parameter in self.parameters]
        repeated = sorted(name for name, times in Counter(names).items() if times > 1)
        if repeated:
            raise AacmmError(
                f"{self.arm.name}: two effects have the parameter {repeated[0]}; merge these "
                "effects into one"
            )
        if self.arm.covariance is not None:
            permitted = {*names}
            for effect in self.effects:
                extra = _extra_uncertainty_parameters(effect)
                permitted |= {parameter.name for parameter in extra}
            for name in self.arm.covariance.parameters:
                if name not in permitted:
                    raise UnknownNameError("parameter of the covariance", name, names)

    def __repr__(self) -> str:
        labels = ", ".join(effect.label for effect in self.effects)
        return f"ErrorModel({self.arm.name!r}, {labels or 'no effects'})"

    @staticmethod
    def of(model: GivenModel) -> ErrorModel:
        """A model unchanged, or that of an arm, its name or its path, with the causes of the arm
        file.

        Raises:
            UnknownNameError, ArmFileError: see :meth:`load`.
            AacmmError: ``model`` has another type.
        """
        if isinstance(model, ErrorModel):
            return model
        arm = as_arm(model, "model")
        path = arm.name if isinstance(model, Arm) else str(model)
        effects: tuple[Effect, ...] = ()
        if arm.file is not None and (arm.file.effects or arm.file.discrepancy):
            from aacmm_pin.effects.text import effects_of_file  # loads every cause

            effects = effects_of_file(arm, path)
        try:
            return ErrorModel(arm, effects)
        except UnknownNameError as error:
            raise ArmFileError(path, "covariance.parameters", str(error)) from None
        except AacmmError as error:
            raise ArmFileError(path, "effects", str(error)) from None

    @staticmethod
    def arm_of(model: GivenModel) -> Arm:
        """The arm of a model; see :meth:`of` for errors."""
        return model.arm if isinstance(model, ErrorModel) else as_arm(model, "model")

    @staticmethod
    def load(name_or_path: str | Path) -> ErrorModel:
        """Load a bundled arm by name, or an arm file by path, with its ``[[effects]]``.

        Raises:
            UnknownNameError, ArmFileError: see :meth:`aacmm_pin.Arm.load`; also for an invalid
                cause.
        """
        return ErrorModel.of(name_or_path)

    def file(self) -> ArmFile | UrdfArmFile:
        """The content of the arm file of this model.

        Raises:
            AacmmError: the arm comes neither from an arm file nor from a regular URDF file.
            ArmFileError: an arm file cannot state the name of the URDF.
        """
        file = self.arm.file
        if file is None or (isinstance(file, UrdfArmFile) and not file.urdf.file):
            raise AacmmError(
                f"{self.arm.name}: this arm has no file; expected an arm from an arm file"
            )
        from aacmm_pin.effects.text import entries_of  # loads every cause

        file = file.model_copy(update=entries_of(self.effects))
        if isinstance(file, UrdfArmFile):
            return validated(UrdfArmFile, file.model_dump(by_alias=True), file.name)
        return file

    def text(self, comment: str = "", path: str | Path | None = None) -> str:
        """The arm file of this model as TOML; see :meth:`file`."""
        return arm_text(self.file(), comment, path)

    def save(self, path: str | Path, force: bool = False, comment: str = "") -> None:
        """Save the arm file of this model, with ``comment`` at its beginning.

        Raises:
            OutputError: see :func:`aacmm_pin._support.output_files.whole_file`.
            AacmmError: see :meth:`file`.
        """
        from aacmm_pin._support.output_files import whole_file
        from aacmm_pin._support.text_escaping import encodable

        text = self.text(comment, path)
        with whole_file(path, force) as temporary:
            temporary.write_text(encodable(text), encoding="utf-8")

    def with_effects(self, *effects: GivenCause) -> ErrorModel:
        """The model with more causes, which replace the same causes at the same places."""
        added = as_causes(effects, self)
        replaced = {effect.identity for effect in added}
        kept = [effect for effect in self.effects if effect.identity not in replaced]
        return replace(self, effects=(*kept, *added))

    @property
    def without_covariance(self) -> ErrorModel:
        """The model without the covariance; parameters in it are exact."""
        if self.arm.covariance is None:
            return self
        names = {*self.arm.covariance.parameters}
        parameters = [
            replace(parameter, half_width=None, u=0.0) if parameter.name in names else parameter
            for parameter in self.arm.parameters
        ]
        effects = []
        for effect in self.effects:
            is_named = any(parameter.name in names for parameter in effect.parameters())
            effects.append(replace(effect, u=(), nonlinear_u=0.0) if is_named else effect)
        arm = replace(self.arm, parameters=tuple(parameters), covariance=None)
        return ErrorModel(arm, effects)

    def restricted(self, effects: tuple[Effect, ...]) -> ErrorModel:
        """The arm with only these causes, and their part of the covariance."""
        if self.arm.covariance is None:
            return replace(self, effects=effects)
        parameters = [*self.arm.parameters]
        for effect in effects:
            parameters += [*effect.parameters(), *_extra_uncertainty_parameters(effect)]
        covariance = self.arm.covariance.restricted(p.name for p in parameters)
        return ErrorModel(replace(self.arm, covariance=covariance), effects)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the arm, then of the causes, as columns of :meth:`sensitivity`.

        The covariance in the arm file replaces the u of each parameter that it names.
        """
        u = {} if self.arm.covariance is None else self.arm.covariance.u
        parameters = [*self.arm.parameters]
        for effect in self.effects:
            for parameter in effect.parameters():
                parameters.append(replace(parameter, u=u.get(parameter.name, parameter.u)))
        return tuple(parameters)

    def covariance(self) -> Array:
        """The covariance of all parameters, ``(p, p)`` [their units]; independent if not in the arm
        file.
        """
        parameters = self.parameters
        matrix = np.diag([p.u**2 for p in parameters])
        if self.arm.covariance is None:
            return matrix
        index = {p.name: i for i, p in enumerate(parameters)}
        stated = self.arm.covariance.restricted(index)
        if stated is not None:
            rows = np.array([index[name] for name in stated.parameters])
            matrix[np.ix_(rows, rows)] = stated.matrix()
        return matrix

    def predict(
        self,
        q: ArrayLike,
        conditions: Conditions | None = None,
        at: str | None = None,
        *,
        as_referenced: bool = False,
    ) -> Array:
        """Compute the exact positions of the tip at joint angles ``q``: ``(n, 3)`` [m].

        Args:
            q: joint angles from the readings ``(n, nq)`` [rad]; with couplings see
                :meth:`aacmm_pin.Arm.joint_angles`.
            conditions: conditions of the records, if causes depend on them.
            at: name of a frame; default the tip.
            as_referenced: include errors of the references: the coordinates that they state.

        Raises:
            ShapeError: ``q`` is not finite ``(n, nq)``, or ``conditions`` has another number of
                records.
            MissingConditionError: a condition that a cause needs is missing.
        """
        return self.state(q, conditions, at, as_referenced=as_referenced).position

    def correct(self, readings: ArrayLike, conditions: Conditions | None = None) -> Array:
        """Compute corrected coordinates of the tip from readings ``(n, nq)`` [rad]: ``(n, 3)`` [m].

        For an arm with couplings, first use :meth:`aacmm_pin.Arm.joint_angles`. Omit records for
        which :meth:`known_at` is False.

        Raises:
            ShapeError, MissingConditionError: see :meth:`predict`.
            AacmmError: a reading is outside the known range of a cause.
        """
        return self.predict(readings, conditions)

    def input_warnings(self, q: Array, conditions: Conditions) -> list[Note]:
        """Notes on angles ``q`` ``(n, nq)`` [rad] outside the limits, and on implausible
        conditions, such as of another unit or clock.

        Raises:
            MissingConditionError: a condition that a cause needs is missing.
        """
        notes = [*whole_turn_notes(q, self.arm.limits, self.arm.chain.prismatic)]
        if any(isinstance(effect.nonlinear, TimeConstant) for effect in self.effects):
            notes += conditions.odd_clock
        are_used = any("temperature" in effect.needs for effect in self.effects)
        notes += conditions.temperature_notes(self.arm.reference_temperature, are_used=are_used)
        unknown = self.other_targets(conditions)
        if unknown:
            notes.append(Note("markers_unknown", {"arm": self.arm.name, "markers": unknown}))
        for effect in self.effects:
            notes += effect.validity_notes(conditions)
        return notes

    def other_targets(self, conditions: Conditions) -> list[str]:
        """Markers whose place the arm does not state; :meth:`predict` then returns the tip."""
        stated = {effect.place for effect in self.effects if effect.location_field() == "marker"}
        labels = dict.fromkeys(conditions.labels("marker").tolist())
        return [label for label in labels if label and label not in stated]

    def known_at(self, q: ArrayLike) -> Mask:
        """Whether each cause is known at the angles ``q`` ``(n, nq)``: ``(n, effects)``.

        An error curve is known only in its range. ``q`` may have a wrong unit.

        Raises:
            ShapeError: ``q`` is not a finite ``(n, nq)`` array.
        """
        q = batch(q, self.arm.nq, "q", "rad or another unit")
        is_known = np.ones((len(q), len(self.effects)), dtype=bool)
        for k, joint, (low, high) in self._known_ranges():
            is_known[:, k] = (q[:, joint] >= low) & (q[:, joint] <= high)
        return is_known

    def _known_ranges(self) -> Iterator[tuple[int, int, tuple[float, float]]]:
        """Number of the cause, number of the joint (both from 0) and range of each cause that is
        not known at all angles.
        """
        for k, effect in enumerate(self.effects):
            if effect.known_range is not None and effect.row is not None:
                yield k, int(self.arm.chain.joint[axis(effect.row)]), effect.known_range

    def restricted_to_known_range(self) -> ErrorModel:
        """The model with joint limits reduced to the known ranges of its causes.

        Raises:
            AacmmError: see :meth:`known_within`.
        """
        limits = self.known_within(self.arm.limits)
        if np.array_equal(limits, self.arm.limits):
            return self
        return replace(self, arm=replace(self.arm, limits=limits))

    def known_within(self, limits: Array) -> Array:
        """Limits of the joints reduced to the known ranges of the causes, ``(nq, 2)`` [rad].

        Raises:
            AacmmError: no angle within the limits of a joint is in the known range.
        """
        limits = limits.copy()
        margin = 2 * AT_LIMIT
        for k, joint, (low, high) in self._known_ranges():
            limits[joint, 0] = max(limits[joint, 0], low + margin)
            limits[joint, 1] = min(limits[joint, 1], high - margin)
            if limits[joint, 0] >= limits[joint, 1]:
                effect = self.effects[k]
                expected_range = f"{effect.label}{known_range_in_words(effect)}"
                raise AacmmError(
                    f"{self.arm.name}: no angle within the limits of joint {joint + 1} is in the "
                    f"range of {expected_range}; expected a common range"
                )
        return limits

    def sensitivity(
        self, q: ArrayLike, conditions: Conditions | None = None, at: str | None = None
    ) -> Array:
        """∂(position)/∂parameters at ``q`` ``(n, nq)`` [rad]: ``(n, 3, len(parameters))`` [m/unit].

        For arguments and errors see :meth:`predict`.
        """
        state = self.state(q, conditions, at)
        effects = (*of_geometry(self.arm), *self.effects)
        return np.concatenate([sensitivity(effect, state) for effect in effects], axis=2)

    def state(
        self,
        q: ArrayLike,
        conditions: Conditions | None = None,
        at: str | None = None,
        *,
        as_referenced: bool = False,
    ) -> State:
        """The arm in n records, displaced by all causes at their values; see :meth:`predict`."""
        q = batch(q, self.arm.nq, "q", "rad")
        conditions = Conditions(len(q)) if conditions is None else conditions
        if conditions.n != len(q):
            raise ShapeError(
                f"conditions have {conditions.n} records; expected {len(q)}, as many as q"
            )
        for name in ("approach", "torque"):
            values = getattr(conditions, name)
            if values is not None and values.shape[1] != self.arm.nq:
                raise ShapeError(
                    f"{name} has {values.shape[1]} columns; expected {self.arm.nq}, one "
                    "for each joint"
                )
        return displaced(self.arm, self.effects, q, conditions, self.arm.place(at), as_referenced)


def displaced(
    arm: Arm,
    effects: tuple[Effect, ...],
    q: Array,
    conditions: Conditions,
    target: int,
    as_referenced: bool,
) -> State:
    """The state with every place displaced by the exact causes; weights act on the deflected arm.

    Errors of the references come last: they do not rotate the arm relative to gravity.
    """
    acting = [effect for effect in effects if any(effect.values)]
    of_reference = [effect for effect in acting if effect.of_reference]
    elastic = [effect for effect in acting if effect.elastic]
    stiff = [effect for effect in acting if not (effect.elastic or effect.of_reference)]
    nominal = State(arm, q, conditions, target)
    state = replace(nominal, twists=_twists(stiff, nominal, {}))
    state = static_equilibrium(elastic, state)
    if as_referenced and of_reference:
        state = replace(state, twists=_twists(of_reference, state, state.twists))
    return state


def static_equilibrium(elastic: list[Effect], state: State) -> State:
    """The state in equilibrium.

    Raises:
        AacmmError: the iteration does not converge.
    """
    if not elastic:
        return state
    of_stiff_causes = state.twists
    for _ in range(MOST_EQUILIBRIUM_STEPS):
        twists = _twists(elastic, state, of_stiff_causes)
        changes = [np.abs(twist - state.twists.get(place, 0.0)) for place, twist in twists.items()]
        state = replace(state, twists=twists)
        if all((change < SAME_TWIST).all() for change in changes):
            return state
    labels = ", ".join(effect.label for effect in elastic)
    came = f"no static equilibrium after {MOST_EQUILIBRIUM_STEPS} iterations"
    raise AacmmError(f"{state.arm.name}: {labels}: {came}; reduce the compliances or masses")


def _twists(effects: list[Effect], state: State, others: Mapping[int, Array]) -> dict[int, Array]:
    """Twists by place, added to ``others``."""
    twists = dict(others)
    for effect in effects:
        for place, twist in effect.exact(state):
            twists[place] = twists[place] + twist if place in twists else twist
    return twists


def require_shown(effect: Effect, arm: Arm, q: Array, conditions: Conditions, source: str) -> None:
    """Check that records show an effect that depends on conditions, such as a seat, target or time.

    Args:
        q: angles of the records ``(n, nq)`` [rad].

    Raises:
        AacmmError: the effect displaces nothing in the records.
    """
    state = State(arm, q, conditions, arm.chain.tip)
    if not effect.needs or any(d.columns.any() for d in effect.displacements(state)):
        return
    columns = ", ".join(CONDITION_COLUMNS[need] for need in effect.needs)
    raise AacmmError(
        f"{effect.key}: the cause has no effect in {source}; take records with other values of "
        f"{columns}"
    )


GivenCause = Effect | str
"""A cause of error, or its text for :func:`aacmm_pin.effects.cause_of`."""


def as_causes(
    causes: GivenCause | Iterable[GivenCause], model: ErrorModel, present: Collection[str] = ()
) -> tuple[Effect, ...]:
    """Causes, or texts for :func:`cause_of`; a single one counts as a list.

    Raises:
        UnknownNameError, AacmmError: see :func:`cause_of`; an item has another type.
    """
    effects: list[Effect] = []
    as_list: Iterable[object] = [causes] if isinstance(causes, Effect | str) else causes
    for given in as_list:
        if isinstance(given, Effect):
            effects.append(given)
        elif isinstance(given, str):
            from aacmm_pin.effects.text import cause_of  # loads every cause

            effects.append(cause_of(given, model, present))
        else:
            came = f"a cause is of type {type(given).__name__}"
            raise AacmmError(f"{came}; expected an Effect, or text such as 'encoder_gain:5'")
    return tuple(effects)


GivenModel = Arm | ErrorModel | str | Path
"""An arm or a model, or the bundled name or the path of the file of either."""


def loaded(model: GivenModel) -> Arm | ErrorModel:
    """A model or an arm unchanged, or the model of a name or path.

    Raises:
        UnknownNameError, ArmFileError: see :meth:`ErrorModel.load`.
    """
    return ErrorModel.load(model) if isinstance(model, str | Path) else model


def _extra_uncertainty_parameters(effect: Effect) -> list[Parameter]:
    return [p for term in extra_uncertainty_effects(effect) for p in term.parameters()]
