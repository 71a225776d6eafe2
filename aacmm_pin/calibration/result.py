"""The result of a calibration, and the base in the references."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd

from aacmm_pin._support.arrays import Array
from aacmm_pin._support.display import Note, Shown, notes_in_json, report
from aacmm_pin._support.distributions import chi2_sf
from aacmm_pin._support.plain_values import of_models, plain
from aacmm_pin._support.units import MM
from aacmm_pin.arm import COVERAGE_FACTOR
from aacmm_pin.calibration.calibrated_arm import calibrated_model
from aacmm_pin.calibration.cross_validation import HeldOut, rms, rms_residual
from aacmm_pin.calibration.estimation import fit
from aacmm_pin.calibration.fit import LEAST_DOF, Fit
from aacmm_pin.calibration.identifiability import Observability
from aacmm_pin.calibration.parameters import ASSEMBLED
from aacmm_pin.calibration.problem import Frame, Problem
from aacmm_pin.calibration.repeatability import Repeatability, repeatability_of
from aacmm_pin.calibration.setup import sessions_of
from aacmm_pin.calibration.shared_exclusions import Exclusions, exclusions_of
from aacmm_pin.effects import CONDITION_COLUMNS, ErrorModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CALIBRATION_SCHEMA = "aacmm-pin/calibration/1"
OPEN_PART = 0.02
"""Part of its width that leaves a parameter known in combination."""
HARDLY_KNOWN = 0.1
"""Part of its width with which u leaves a parameter without stated u hardly known."""
UNCHANGED = 0.95
"""Part of the stated u with which a parameter has learnt nothing …"""
LESS_THAN_STATED = 0.5**0.5
"""… and less than was stated."""
LARGE_ROTATION_U = 1e-2
"""A base whose rotation has a larger u is open [rad], beyond first order."""


def residuals_by_record(fits: Mapping[str, Fit]) -> pd.DataFrame:
    """One row a record: line in the file, labels, tip minus target by each fit [mm]."""
    records = next(iter(fits.values())).problem.measurements
    table: dict[str, Any] = {"row": records.row}
    for name in ("record", "operator", "seat", "marker", "session"):
        labels = getattr(records.conditions if name in CONDITION_COLUMNS else records, name)
        table |= {} if labels is None else {name: labels}
    for name, solution in fits.items():
        deviation = solution.system.deviation
        table |= {f"{axis}_{name}_mm": deviation[:, k] / MM for k, axis in enumerate("xyz")}
        table[f"{name}_mm"] = np.linalg.norm(deviation, axis=1) / MM
        table |= {f"turn_{name}_rad": solution.turns} if solution.problem.turns else {}
    return pd.DataFrame(table)


@dataclass(frozen=True, eq=False)
class Calibration(Shown):
    """The result of a calibration: the calibrated arm and numbers for its quality.

    Attributes:
        setup: least-squares problem of the set-up alone (reference frame, target) with the arm
            before calibration.
        held_out: residuals of held-out records for each kind of group; empty without ``hold_out``.
    """

    fit: Fit
    setup: Problem
    held_out: tuple[HeldOut, ...]
    notes: tuple[Note, ...]

    @cached_property
    def model(self) -> ErrorModel:
        """The calibrated arm with its causes and the covariance of its parameters."""
        return calibrated_model(self.fit)

    @cached_property
    def before(self) -> Fit:
        """The fit of the set-up alone, with the arm before calibration."""
        return fit(self.setup, used=self.fit.used)

    @property
    def rms_before(self) -> float:
        """The RMS residual of the used records with the arm before calibration [m]."""
        return rms_residual(self.before, self.fit.used)

    @property
    def rms(self) -> float:
        """The same with the calibrated arm [m]."""
        return rms_residual(self.fit, self.fit.used)

    @property
    def noise(self) -> float:
        """The RMS residual by the stated noise and the estimated scatter alone [m]."""
        return self.fit.expected_rms(self.fit.residual_noise)

    @property
    def turns(self) -> dict[str, float] | None:
        """The RMS rotation between stated and computed orientations [rad]: ``nominal`` (arm before
        calibration), ``calibrated`` and ``noise`` (expected from noise alone). None without
        orientations.
        """
        turned = self.fit.used & self.fit.observations.oriented
        if not turned.any():
            return None
        noise = np.sqrt(np.trace(self.fit.residual_noise[turned, 3:, 3:], axis1=1, axis2=2).mean())
        before, after = (rms(fit.turns[turned]) for fit in (self.before, self.fit))
        return {"nominal": before, "calibrated": after, "noise": float(noise)}

    @property
    def p_value(self) -> float | None:
        """Probability of an equal or larger χ² if the model and the stated noise are correct; None
        if the noise is not stated, or the degrees of freedom are too few.
        """
        chi2 = self.fit.chi2_stated
        return None if chi2 is None or chi2.dof < LEAST_DOF else float(chi2_sf(*chi2))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The combinations that the records do not determine; their values do not change."""
        return self.fit.undetermined.words

    @cached_property
    def observability(self) -> Observability:
        """The observability indices of the records."""
        typical = self.fit.problem.vector.typical
        jacobian = self.fit.system.jacobian[:, : typical.size] * typical
        return Observability.of(jacobian, int(self.fit.used.sum()))

    @property
    def covariance(self) -> Array:
        """The covariance of :attr:`parameters`, ``(p, p)`` [their SI units]."""
        p = self.fit.problem.vector.size
        return self.fit.covariance[:p, :p]

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """The estimated parameters, one row each.

        The columns are ``before``, ``after``, ``change``, ``u`` and ``U`` (k = 2) in the unit of
        the row, and ``known``: ``measured``, ``hardly`` (the records add little), ``as stated``
        (they add nothing to the prior) or ``in combination``, without u, if it is part of a
        combination in :attr:`undetermined`. u contains the spread along such combinations, if this
        is small beside the width of the parameter and beside what assembly allows.
        """
        problem = self.fit.problem
        vector = problem.vector
        units = [parameter.unit for parameter in vector.parameters]
        spread = np.linalg.norm(self.fit.undetermined.spread, axis=1)
        # A target may be a metre from where it is stated.
        assembled = np.array([ASSEMBLED.get(unit, np.inf) for unit in units])
        is_open = spread > OPEN_PART * np.minimum(problem.widths, assembled)
        u = np.where(is_open, np.nan, np.hypot(np.sqrt(np.diag(self.covariance)), spread))
        before = vector.stated_values + problem.start
        change = self.fit.point.x - problem.start
        table = pd.DataFrame({"parameter": vector.names, "unit": units})
        table["unit"] = table["unit"].replace("m", "mm")
        factor = np.where(table["unit"] == "mm", MM, 1.0)
        expanded = COVERAGE_FACTOR * u
        values = {"before": before, "after": before + change, "change": change, "u": u}
        for name, value in (values | {"U": expanded}).items():
            table[name] = value / factor
        as_stated = problem.stated & (u > UNCHANGED * problem.widths)
        hardly = u > np.where(problem.stated, LESS_THAN_STATED, HARDLY_KNOWN) * problem.widths
        words = ["in combination", "as stated", "hardly"]
        table["known"] = np.select([np.isnan(u), as_stated, hardly], words, "measured")
        return table

    @cached_property
    def residuals(self) -> pd.DataFrame:
        """One row for each record: line in the file, seat, residual before and after calibration
        [mm], and whether the fit used it.
        """
        table = residuals_by_record({"before": self.before, "after": self.fit})
        return table.assign(used=self.fit.used)

    @property
    def excluded(self) -> pd.DataFrame:
        """The excluded records: row, labels, residual [mm] and reason."""
        table = self.residuals[self.fit.excluded]
        columns = [c for c in ("row", "record", "seat", "marker", "session") if c in table]
        reason = str(Note("outlier"))
        return (
            table[[*columns, "after_mm"]]
            .rename(columns={"after_mm": "residual_mm"})
            .assign(reason=reason)
        )

    @cached_property
    def exclusions(self) -> Exclusions:
        """Whether the excluded records are gross errors of single records."""
        return exclusions_of(self.fit)

    @cached_property
    def repeatability(self) -> Repeatability | None:
        """What the repeated postures among the used records show; None without."""
        return repeatability_of(self.fit)

    def summary(self) -> dict[str, Any]:
        """The content of the JSON file, of schema ``aacmm-pin/calibration/1``."""
        fit = self.fit
        scatters = fit.noise.scatters
        chi2 = None
        if fit.chi2_stated is not None:
            value, dof = fit.chi2_stated
            chi2 = {"value": value, "dof": dof, "p_value": self.p_value}
        excluded = self.excluded[["row", "reason", "residual_mm"]]
        before, after, noise = np.array([self.rms_before, self.rms, self.noise]) / MM
        sizes = {"nominal": before, "calibrated": after, "noise": noise}
        summary = {
            "schema": CALIBRATION_SCHEMA,
            "arm": self.model.arm.name,
            "records": {
                "used": int(fit.used.sum()),
                "silent": int((~fit.used & ~fit.excluded).sum()),
                "excluded": excluded,
                "exclusions": self.exclusions.summary(),
            },
            "rms_mm": of_models(sizes),
            "chi2": chi2,
            "rms_rad": self.turns and of_models(self.turns),
            "unmodelled_mm": fit.scatter / MM,
            "unmodelled_rad": scatters.rotation if self.turns else None,
            "unmodelled_seat_mm": scatters.seat / MM or None,
            "noise_stated": fit.noise_is_stated,
            "parameters": self.parameters,
            "undetermined": list(self.undetermined),
            "observability": vars(self.observability),
            "held_out": [held.summary() for held in self.held_out],
            **notes_in_json(self.notes),
        }
        return dict(plain(summary))

    def __str__(self) -> str:
        exclusions = self.exclusions
        excluded = f"{exclusions.excluded} excluded{', no gross errors' * exclusions.doubtful}"
        text = (
            f"The RMS residual of {exclusions.used} records of {self.model.arm.name} ({excluded}) "
            f"is {self.rms_before / MM:.4f} mm before and {self.rms / MM:.4f} mm after calibration"
        )
        for held in self.held_out:
            text += f", {held.rms_after / MM:.4f} mm for held-out {held.kind}"
        return text

    def plot(self, ax: Axes | None = None) -> Figure:
        """Plot the residuals after calibration over the angle of each joint.

        Args:
            ax: axes whose area the panels share; default a new pyplot figure.
        """
        return cast("Figure", report().plots.plot_residuals_over_joints(self, ax=ax))


@dataclass(frozen=True, eq=False)
class BasePlacement:
    """The base in a frame of references.

    Attributes:
        session: label of the session whose frame it is; "" if all records have one.
        rotation, shift: ``x_reference = R x_base + t``, (3, 3) and (3,) [m].
        u_shift: standard uncertainty of t along the axes of the references (3,) [m].
        u_rotation: of the rotation about these axes (3,) [rad].
    """

    session: str
    rotation: Array
    shift: Array
    u_shift: Array
    u_rotation: Array


def base_is_open(fit: Fit) -> bool:
    """Whether the records leave the base open in an unknown frame of the references."""
    if not fit.problem.external:
        return False
    p = fit.problem.widths.size
    variances = np.diag(fit.covariance)[p + 3 : p + 6]
    return fit.undetermined.frame_is_open or bool(variances.max() > LARGE_ROTATION_U**2)


def base_placements(fit: Fit) -> list[BasePlacement]:
    """The base in each unknown frame of the references; none if it is open."""
    problem = fit.problem
    if not problem.external or base_is_open(fit):
        return []
    p = problem.widths.size
    frame = fit.point.frame
    of_frame = fit.covariance[p : p + 6]
    by_session = problem.setup.frame_of_session
    first = sessions_of(problem.measurements)[0] if by_session else ""
    placements = [_base_placement(first, frame.rotation, frame.shift, of_frame[:, p : p + 6])]
    for session, entries in problem.vector.of_sessions():
        displaced = Frame(frame.rotation, frame.shift).moved(fit.point.x[entries])
        cross = of_frame[:, entries]
        covariance = of_frame[:, p : p + 6] + fit.covariance[entries, entries] + cross + cross.T
        # Back from the frame of the first session to that of the session.
        to_first = problem.setup.moved_frames.get(session, (np.eye(3), np.zeros(3)))
        rotation = to_first[0].T @ displaced.rotation
        shift = to_first[0].T @ (displaced.shift - to_first[1])
        placements.append(_base_placement(session, rotation, shift, covariance))
    return placements


def _base_placement(
    session: str, rotation: Array, shift: Array, covariance: Array
) -> BasePlacement:
    """From the covariance in the axes of the base (6, 6)."""
    rotations = np.kron(np.eye(2), rotation)
    u = np.sqrt(np.diag(rotations @ covariance @ rotations.T))
    return BasePlacement(session, rotation, shift, u[:3], u[3:])
