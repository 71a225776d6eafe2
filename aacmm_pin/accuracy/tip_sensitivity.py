"""Sources of error, and their effect on the position: sensitivity, covariance, bounds.

Where independent sources are needed, principal axes replace correlated ones. With D = diag(u) and
the correlation matrix R = V λ Vᵀ, the columns of ``D V √λ`` are independent, with the covariance
``D R D``. If eigenvalues coincide, the axes are not unique: then the volume jumps with the
slightest correlation, unlike the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import ArrayLike

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, Index, Mask, vector
from aacmm_pin._support.display import Note, Shown
from aacmm_pin._support.units import MM, count
from aacmm_pin.arm import COVERAGE_FACTOR, Arm, Parameter
from aacmm_pin.effects import (
    Conditions,
    Effect,
    ErrorModel,
    State,
    displaced,
    extra_uncertainty_effects,
    of_geometry,
    sensitivity,
)
from aacmm_pin.errors import AacmmError, MissingConditionError, UnknownNameError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class ErrorSources(Shown):
    """Uncertain parameters of an arm and its effects, and the noise of the encoders.

    Attributes:
        model: the arm and its effects.
        left_out: effects that depend on missing conditions.
        at: frame whose origin is the point.
        parameters: those with an uncertainty; of effects with bounds ± k u, k = 2.
        columns: their numbers among the parameters of the model, then the noise of each joint.
        correlation: (p, p); None if independent.
        not_included: labels of causes left out, also by an arm without its effects.
    """

    model: ErrorModel
    left_out: tuple[Effect, ...]
    at: str
    parameters: tuple[Parameter, ...]
    columns: tuple[int, ...]
    correlation: Array | None = None
    not_included: tuple[str, ...] = ()

    def __str__(self) -> str:
        names = ", ".join(parameter.name for parameter in self.parameters)
        return f"{count(len(self.parameters), 'source')} of error at {self.at}: {names}"

    @staticmethod
    def of(
        model: Arm | ErrorModel,
        at: str | None,
        encoder_noise: ArrayLike | None,
        q: Array,
        conditions: Conditions | None,
    ) -> ErrorSources:
        """The sources of ``model`` at ``q`` (n, nq) [rad]."""
        not_passed: list[str] = []  # effects in the file of an arm without them
        if isinstance(model, Arm):
            arm = model
            try:
                model = ErrorModel(arm)
            except UnknownNameError as error:
                raise AacmmError(
                    f"{arm.name}: {error}; use ErrorModel.load in place of Arm.load"
                ) from None
            of_file = ErrorModel.of(arm).effects
            not_passed = [effect.label for effect in of_file if not effect.of_reference]
        extra_effects = chain.from_iterable(map(extra_uncertainty_effects, model.effects))
        model = replace(model, effects=(*model.effects, *extra_effects))
        left_out = _lacking(model, q, conditions)
        not_included = tuple(dict.fromkeys((*not_passed, *(effect.label for effect in left_out))))
        arm = model.arm
        covariance = model.covariance()
        no_source = {
            p.name for e in model.effects if e.of_reference or e in left_out for p in e.parameters()
        }
        noise = arm.encoder_noise
        if encoder_noise is not None:
            is_one = np.ndim(encoder_noise) == 0
            of_joints = np.full(arm.nq, encoder_noise) if is_one else encoder_noise
            noise = vector(of_joints, arm.nq, "encoder_noise", "rad")
            plausible.ENCODER_NOISE.check(noise, "encoder_noise")
        candidates = list(arm.parameters)
        all_u = np.sqrt(np.diag(covariance)).tolist()
        for p, u in list(zip(model.parameters, all_u, strict=True))[len(candidates) :]:
            candidates.append(replace(p, u=u, half_width=COVERAGE_FACTOR * u))
        for j, u in enumerate([] if noise is None else noise.tolist(), start=1):
            candidates.append(
                Parameter(f"encoder_noise{j}", "encoder", j, "rad", 0.0, None, u, "record")
            )
        uncertain = [
            (column, p)
            for column, p in enumerate(candidates)
            if p.u > 0 and p.name not in no_source
        ]
        if not uncertain:
            without = f"; without {', '.join(not_included)}" if not_included else ""
            raise AacmmError(
                f"{arm.name}: no parameter has an uncertainty{without}; state half-widths in the "
                "arm file (uncertainty = {...}) or for the URDF, or the encoder noise"
            )
        columns, parameters = zip(*uncertain, strict=True)
        correlation = _correlation(covariance, np.array(columns))
        return ErrorSources(
            model, left_out, at or arm.tip, parameters, columns, correlation, not_included
        )

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self.model.arm

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects whose conditions are given."""
        of_arm = (e for e in self.model.effects if not e.of_reference)
        return tuple(e for e in of_arm if e not in self.left_out)

    @property
    def u(self) -> Array:
        """(p,) [SI]."""
        return np.array([p.u for p in self.parameters])

    @property
    def lasting(self) -> Mask:
        """Those with one error in all records (p,)."""
        return np.array([p.scope != "record" for p in self.parameters])

    @property
    def bounded(self) -> tuple[int, ...]:
        """Parameters with stated bounds."""
        stated = [p.half_width is not None for p in self.parameters]
        return tuple(np.flatnonzero(stated).tolist())

    @property
    def half_widths(self) -> Array:
        """Bounds (b,) [SI]."""
        half_widths = [p.half_width for p in self.parameters]
        return np.array([bound for bound in half_widths if bound is not None])

    @property
    def taken_as_exact(self) -> tuple[str, ...]:
        """Parameters without stated uncertainty."""
        names = [p.name for p in self.model.parameters]
        variance = dict(zip(names, np.diag(self.model.covariance()), strict=True))
        of_effects = [p.name for effect in self.effects for p in effect.parameters()]
        exact = [name for name in of_effects if variance[name] == 0]
        return (*self.arm.without_uncertainty, *exact)

    @property
    def caveats(self) -> tuple[Note, ...]:
        """Notes on what uncertainties do not include."""
        return caveats(self.arm, self.taken_as_exact)

    @cached_property
    def axes(self) -> Array | None:
        """``V √λ`` as columns (p, p), whose product with its transpose is the correlation; None if
        independent.
        """
        if self.correlation is None:
            return None
        axes = np.eye(len(self.parameters))
        linked = self.correlation != 0
        count, group = scipy.sparse.csgraph.connected_components(linked, directed=False)
        for number in range(count):
            members = np.flatnonzero(group == number)
            if len(members) > 1:
                block = np.ix_(members, members)
                values, vectors = np.linalg.eigh(self.correlation[block])
                # What rounded correlations leave below zero is no variance.
                axes[block] = vectors * np.sqrt(np.maximum(values, 0.0))
        return axes

    def sensitivity(self, q: Array, conditions: Conditions | None = None) -> Array:
        """∂position/∂source at ``q`` (n, nq): (n, 3, p) [m/unit]."""
        arm = self.arm
        columns = np.array(self.columns)
        # Columns: parameters of the arm, parameters of effects, readings.
        if not self.effects:
            of_arm = columns[columns < len(arm.parameters)]
            by_parameters = arm.sensitivity(q, self.at)[:, :, of_arm]
            readings = columns - len(self.model.parameters)
            by_readings = arm.by_readings(arm.jacobian(q, self.at))[:, :, readings[readings >= 0]]
            return np.concatenate([by_parameters, by_readings], axis=2)
        conditions = Conditions(len(q)) if conditions is None else conditions
        state = displaced(arm, self.effects, q, conditions, arm.place(self.at), False)
        blocks, start = [], 0
        for cause in (*of_geometry(arm), *self.model.effects):
            end = start + len(cause.terms)
            wanted = columns[(columns >= start) & (columns < end)] - start
            if wanted.size:
                blocks.append(sensitivity(cause, state)[:, :, wanted])
            start = end
        readings = columns[columns >= start] - start
        if readings.size:
            by_angles, _ = arm.chain.jacobian(state.rotation, state.origin, state.position)
            blocks.append(arm.by_readings(by_angles)[:, :, readings])
        return np.concatenate(blocks, axis=2)

    def generators(self, sensitivity: Array) -> Array:
        """Half-width times sensitivity of each bounded source: (n, 3, b) [m].

        Correlated sources give ``k D V √λ``, k = 2 or half-width/u.
        """
        bounded = list(self.bounded)
        if not bounded:
            raise AacmmError(
                f"{self.arm.name}: no parameter has half-widths, so that only the method "
                "'ellipsoid' gives a volume; state half-widths in the arm file"
            )
        generators = sensitivity[:, :, bounded] * self.half_widths
        if self.axes is not None:
            generators = generators @ self.axes[np.ix_(bounded, bounded)]
        return generators

    def independent(self, contributions: Array) -> Array:
        """Contributions (…, p) of one u of each source as those of independent principal axes."""
        return contributions if self.axes is None else contributions @ self.axes

    def covariance_of(self, sensitivity: Array) -> Array:
        """S Σ Sᵀ of the position (JCGM 102:2011, 6.2): (n, 3, 3) [m²]."""
        scaled = self.independent(sensitivity * self.u)
        return scaled @ scaled.transpose(0, 2, 1)

    def budget(self, products: Array, by: str = "parameter") -> pd.DataFrame:
        """Table of :meth:`AccuracyVolume.budget` from ``products`` (p, p) [m²]: contributions of
        one u of each source times those of each other, summed over coordinates.
        """
        import pandas as pd

        covariances = np.diag(np.diag(products))
        if self.correlation is not None:
            covariances = products * self.correlation
        table = pd.DataFrame(
            {
                "parameter": [p.name for p in self.parameters],
                "joint": pd.array([p.joint for p in self.parameters], dtype="Int64"),
                "kind": [p.kind for p in self.parameters],
                "scope": [p.scope for p in self.parameters],
            }
        )
        if by != "parameter":
            group, names = pd.factorize(table[by], use_na_sentinel=False)
            member = np.eye(len(names))[group]
            table = pd.DataFrame({by: names})
            covariances = member.T @ covariances @ member
        # Rounding leaves a variance below zero if correlated contributions cancel.
        variances = np.maximum(np.diag(covariances), 0.0)
        table["u_mm"] = np.sqrt(variances) / MM
        table["share"] = covariances.sum(axis=1) / covariances.sum()
        return table.sort_values("share", ascending=False, ignore_index=True)


def _lacking(model: ErrorModel, q: Array, conditions: Conditions | None) -> tuple[Effect, ...]:
    """Effects that need a missing condition."""
    effects = [effect for effect in model.effects if not effect.of_reference]
    if not effects or not len(q):
        return ()
    first = Conditions(1) if conditions is None else conditions.take([0])
    state = State(model.arm, q[:1], first, model.arm.chain.tip)
    lacking = []
    for effect in effects:
        try:
            effect.displacements(state)
        except MissingConditionError:
            lacking.append(effect)
    return tuple(lacking)


def _correlation(covariance: Array, columns: Index) -> Array | None:
    """Of the sources in ``columns``; the noise of encoders is independent."""
    correlation = np.eye(len(columns))
    of_parameters = np.flatnonzero(columns < len(covariance))
    block = covariance[np.ix_(columns[of_parameters], columns[of_parameters])]
    if not (block - np.diag(np.diag(block))).any():
        return None
    u = np.sqrt(np.diag(block))
    correlation[np.ix_(of_parameters, of_parameters)] = block / np.outer(u, u)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def omission(labels: Sequence[str]) -> str:
    """End of a sentence on uncertainties without causes of these ``labels``."""
    return f"; this does not include {', '.join(labels)}" if labels else ""


def caveats(arm: Arm, exact: Sequence[str]) -> tuple[Note, ...]:
    """Notes on exact parameters, and on unexplained structure."""
    notes = [Note("taken_as_exact", {"parameters": ", ".join(exact)})] if exact else []
    if arm.unexplained:
        notes.append(
            Note("unexplained_not_in_u", {"arm": arm.name, "unexplained": arm.unexplained})
        )
    return tuple(notes)
