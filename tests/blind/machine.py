"""The arm with its faults: from indications and conditions to the coordinates that a perfect
reference would give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from blind import outside
from blind.chains import Chain
from blind.conditions import Conditions
from blind.encoders import ENCODER, Parameters
from blind.kinematics import Array
from blind.statics import Elastic, Load, Rest, settle
from blind.truth import Hidden


@dataclass(frozen=True, eq=False)
class Machine:
    """An arm whose geometry deviates by ``values`` (R, P) from its file, with ``faults``.

    Attributes:
        small: what every real arm has beside its faults; None for none.
        targets: of markers on the last body, in its axes (M, 3) [m]; None where the tip itself is
            measured.
    """

    arm: Chain
    values: Array
    faults: tuple[Hidden, ...] = ()
    small: outside.SmallTerms | None = None
    targets: Array | None = None

    def with_faults(self, faults: Sequence[Hidden]) -> Machine:
        return replace(self, faults=tuple(faults))

    def joint_angles(self, q: Array, conditions: Conditions) -> Array:
        """Angles of all rows (n, R) [rad] at the indications q (n, nq) [rad]."""
        angles = self.arm.all_angles(q)
        for fault in self.faults:
            if fault.cause in ENCODER:
                assert fault.joint is not None
                i = fault.joint - 1
                angles[:, i] = ENCODER[fault.cause](
                    angles[:, i], fault.parameters, conditions, fault.joint
                )
            elif "joints" in fault.parameters:
                angles[:, fault.parameters["joints"][0] - 1] += self._outside(
                    angles, q, conditions, fault.parameters
                )
        return angles if self.small is None else self.small.added(angles, conditions)

    def _outside(self, angles: Array, q: Array, conditions: Conditions, p: Parameters) -> Array:
        """Term of the angle of a joint (n,) [rad] that no cause of the contract describes."""
        if p["kind"] == "joint_product":
            return outside.joint_product(angles, p)
        if p["kind"] == "other_joint":
            return outside.other_joint(angles, p)
        if p["kind"] == "branch":
            return outside.branch(conditions, p)
        return outside.loaded_gear(angles, self.load(q, conditions), p)

    def load(self, q: Array, conditions: Conditions) -> Array:
        """Torques of all rows (n, R) [N·m] that the sound arm holds."""
        sound = replace(self, values=self.arm.exact, faults=(), small=None)
        return self.arm.all_angles(sound.torque(q, conditions))

    def geometry(self) -> Array:
        """``values`` with the faults of a DH table."""
        values = self.values.copy()
        for fault in self.faults:
            if fault.cause in GEOMETRY:
                assert fault.joint is not None
                name, column, unit = GEOMETRY[fault.cause]
                values[fault.joint - 1, column] += unit * fault.parameters[name]
        return values

    def growth(self, conditions: Conditions) -> Array:
        """Relative growth of the bodies (n, R) with temperature and humidity."""
        growth = np.zeros((len(conditions.time), self.arm.rows))
        for fault in self.faults:
            rows = slice(None) if fault.joint is None else slice(fault.joint - 1, fault.joint)
            if fault.cause == "thermal_expansion":
                rise = conditions.temperature - self.arm.reference_temperature
                growth[:, rows] += fault.parameters["expansion_per_k"] * rise[:, None]
            elif fault.parameters.get("kind") == "humidity":
                for tube in self.arm.tubes():
                    growth[:, tube - 1] += outside.swelling(fault.parameters, conditions)
        return growth

    def lengths(self) -> Array:
        """Of the tubes (R,) [m]."""
        return np.asarray(np.abs(self.arm.spans()).max(axis=1))

    def elastic(self) -> Elastic:
        """The flexibilities among the faults."""
        elastic = Elastic.rigid(self.arm.rows)
        base = 0.0
        for fault in self.faults:
            if fault.cause == "base_compliance":
                base += fault.parameters["compliance_rad_per_nm"]
            elif fault.cause in ELASTIC:
                assert fault.joint is not None
                i = fault.joint - 1
                name, where = ELASTIC[fault.cause]
                length = self.lengths()[i] if fault.cause == "torsional_windup" else 1.0
                getattr(elastic, where)[i] += fault.parameters[name] / length
        return replace(elastic, base=base)

    def rest(self, q: Array, conditions: Conditions) -> Rest:
        """The arm at rest."""
        pieces, growth = self.arm.pieces(self.geometry()), self.growth(conditions)
        return settle(
            self.arm,
            pieces,
            self.joint_angles(q, conditions),
            growth,
            self.elastic(),
            conditions.payload,
        )

    def torque(self, q: Array, conditions: Conditions) -> Array:
        """What the drives hold (n, nq) [N·m]."""
        rest = self.rest(q, conditions)
        load = Load.of(self.arm, rest, conditions.payload)
        moments = np.stack(
            [load.beyond(i, rest.axes[:, i, :3, 3]) for i in range(self.arm.rows)], axis=1
        )
        return -np.einsum("nri,nri->nr", rest.axes[:, :, :3, 2], moments)[:, self.arm.moving]

    def observed(self, q: Array, conditions: Conditions) -> Array:
        """Coordinates of the tip (n, 3) [m] that a perfect reference in the base frame states."""
        last = self.rest(q, conditions).last
        tip = last[:, :3, 3].copy()
        for fault in self.faults:
            p = fault.parameters
            if fault.cause == "stylus_offset":
                tip += 1e-3 * last[:, :3, :3] @ _vector(p)
            elif fault.cause == "stylus_bending":
                tip += 1e-3 * p["level_sag_mm"] * self._down_across_stylus(last)
            elif fault.cause == "seat_error":
                tip -= 1e-3 * np.where(
                    conditions.seat[:, None] == int(p["seat"][1:]) - 1, _vector(p), 0.0
                )
            elif fault.cause == "unexplained":
                tip += outside.shift(p, last[:, :3, 3], conditions)
        if self.targets is not None:
            tip += np.einsum("nij,nj->ni", last[:, :3, :3], self.targets[conditions.marker])
        return tip

    def _down_across_stylus(self, last: Array) -> Array:
        axis = last[:, :3, :3] @ self.arm.stylus
        down = self.arm.gravity / np.linalg.norm(self.arm.gravity)
        return np.asarray(down - axis * (axis @ down)[:, None])

    def jacobian(self, q: Array) -> Array:
        """Of the rigid arm at the indications, (n, 3, nq) [m/rad]."""
        return self.arm.jacobian(q, self.values)

    def shift_by(self, fault: Hidden, q: Array, conditions: Conditions) -> Array:
        """What ``fault`` moves the observed coordinates by beside all others (n, 3) [m]."""
        others = [other for other in self.faults if other is not fault]
        with_it = self.with_faults([*others, fault]).observed(q, conditions)
        return with_it - self.with_faults(others).observed(q, conditions)

    def moves(self, fault: Hidden, q: Array, conditions: Conditions) -> float:
        """The same as rms over the records [m]."""
        return float(np.sqrt((self.shift_by(fault, q, conditions) ** 2).sum(axis=1).mean()))

    def sized(self, q: Array, conditions: Conditions) -> tuple[Hidden, ...]:
        """The faults with what each moves the tip by, the largest first."""
        sized = [
            replace(fault, size_um=1e6 * self.moves(fault, q, conditions)) for fault in self.faults
        ]
        return tuple(sorted(sized, key=lambda fault: -fault.size_um))

    def touching(self, q: Array, conditions: Conditions, points: Array) -> Array:
        """Indications near q (n, nq) at which the reference states ``points`` (n, 3) [m]
        exactly.
        """
        for _ in range(20):
            missing = points - self.observed(q, conditions)
            if np.abs(missing).max() < 1e-12:
                return q
            j = self.jacobian(q)
            q = q + np.einsum(
                "nkj,nk->nj",
                j,
                np.linalg.solve(j @ j.transpose(0, 2, 1), missing[..., None])[..., 0],
            )
        raise RuntimeError(f"the tip stays {np.abs(missing).max():.1e} m away from its points")


def _vector(p: Parameters) -> Array:
    return np.array([p["x_mm"], p["y_mm"], p["z_mm"]])


GEOMETRY = {
    "link_length": ("a_mm", 0, 1e-3),
    "joint_distance": ("d_mm", 1, 1e-3),
    "link_twist": ("alpha_rad", 2, 1.0),
    "joint_zero_offset": ("offset_rad", 3, 1.0),
}
"""Parameter, column of the DH values, and unit."""

ELASTIC = {
    "joint_compliance": ("compliance_rad_per_nm", "joint"),
    "bearing_tilt": ("compliance_rad_per_nm", "tilt"),
    "link_bending": ("flexibility_rad_per_nm2", "bend"),
    "torsional_windup": ("compliance_rad_per_nm", "twist"),
    "counterbalance": ("level_turn_rad", "spring"),
}
"""Parameter and field of Elastic; the compliance of a windup is that of the whole tube, length /
GJ.
"""
