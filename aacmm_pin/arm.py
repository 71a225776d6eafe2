"""Arms and their poses: the only computing module that imports Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from aacmm_pin.arm_file import ArmFile, load_arm_file
from aacmm_pin.checks import Array, batch
from aacmm_pin.dh import KINDS, DHTable
from aacmm_pin.errors import AacmmError, ShapeError, UnknownNameError, UnsupportedArmError
from aacmm_pin.parameter import Parameter
from aacmm_pin.urdf import urdf_text


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm: its Pinocchio model and, where it has one, its DH table.

    Attributes:
        name: name for titles and messages.
        model: the Pinocchio model; treat it as read-only.
        tip: name of the frame whose origin is the tip.
        limits: joint limits (nq, 2) [rad].
        parameters: geometric parameters with their uncertainties, in the order of :meth:`sensitivity`.
        dh: the DH table, or None for an arm that came as URDF alone.
        encoder_noise: standard uncertainty of one reading (nq,) [rad], or None.
        stylus_axis: direction of the stylus in the tip frame (3,), or None.
        source: where the numbers come from.
    """

    name: str
    model: Any
    tip: str
    limits: Array
    parameters: tuple[Parameter, ...]
    dh: DHTable | None = None
    encoder_noise: Array | None = None
    stylus_axis: Array | None = None
    source: str = ""

    def __repr__(self) -> str:
        table = "no DH table" if self.dh is None else f"{self.dh.rows} {self.dh.convention} rows"
        return f"Arm({self.name!r}, {self.nq} joints, {table}, tip {self.tip!r})"

    @property
    def without_uncertainty(self) -> tuple[str, ...]:
        """Names of the geometric parameters for which no uncertainty was stated; they count as exact."""
        return tuple(p.name for p in self.parameters if p.half_width is None and p.u == 0)

    @staticmethod
    def load(name_or_path: str | Path) -> Arm:
        """A bundled arm by name (``sino6``, ``zero6``) or an arm file by path.

        Raises:
            UnknownNameError, ArmFileError: see :func:`aacmm_pin.arm_file.load_arm_file`.
        """
        return Arm.from_file(load_arm_file(name_or_path))

    @staticmethod
    def from_file(arm: ArmFile) -> Arm:
        """The arm of a validated arm file: DH table to URDF to Pinocchio."""
        model = pin.buildModelFromXML(urdf_text(arm))
        model.gravity.linear = np.array(arm.gravity_m_s2)
        axis = None if arm.stylus is None else np.array(arm.stylus.axis) / np.linalg.norm(arm.stylus.axis)
        return Arm(
            name=arm.name,
            model=model,
            tip="tip",
            limits=arm.limits,
            parameters=arm.dh_parameters(),
            dh=arm.dh,
            encoder_noise=arm.encoder_noise,
            stylus_axis=axis,
            source=arm.source,
        )

    @staticmethod
    def from_urdf(
        path: str | Path, frame: str, *, translation_half_width: float = 0.0, rotation_half_width: float = 0.0
    ) -> Arm:
        """Any fixed-base arm with revolute or prismatic joints, by its URDF.

        Its parameters are the six components of every joint placement (three shifts, three turns about the axes of the
        placement), each known within ± the half-width.

        Args:
            path: URDF file; meshes are not needed.
            frame: name of the link or frame whose origin is the tip.
            translation_half_width: bound of every placement shift [m].
            rotation_half_width: bound of every placement turn [rad].

        Raises:
            AacmmError: the file cannot be read or is not URDF.
            UnsupportedArmError: a joint takes more than one number (``continuous``, planar, floating).
            UnknownNameError: no such frame; lists the frames.
        """
        if not Path(path).is_file():
            raise AacmmError(f"{path}: no such file")
        try:
            model = pin.buildModelFromUrdf(str(path))
        except (ValueError, RuntimeError) as error:
            raise AacmmError(f"{path}: not a URDF that Pinocchio can load: {error}") from None
        return Arm.from_model(
            model,
            frame,
            source=str(path),
            translation_half_width=translation_half_width,
            rotation_half_width=rotation_half_width,
        )

    @staticmethod
    def from_model(
        model: Any,
        frame: str,
        *,
        source: str = "",
        translation_half_width: float = 0.0,
        rotation_half_width: float = 0.0,
    ) -> Arm:
        """The same from a Pinocchio model that is already there; the joints past ``frame`` are locked at zero.

        Raises:
            UnsupportedArmError, UnknownNameError: see :meth:`from_urdf`.
        """
        for half_width in (translation_half_width, rotation_half_width):
            if not (np.isfinite(half_width) and half_width >= 0):
                raise AacmmError(f"half-width is {half_width}, expected a number that is not negative")
        model = _serial_part(model, frame)
        return Arm(
            name=model.name,
            model=model,
            tip=frame,
            limits=np.column_stack([model.lowerPositionLimit, model.upperPositionLimit]),
            parameters=_placement_parameters(model, translation_half_width, rotation_half_width),
            source=source,
        )

    @property
    def nq(self) -> int:
        """Number of joints."""
        return int(self.model.nq)

    @property
    def gravity(self) -> Array:
        """Acceleration of gravity in the base frame (3,) [m/s²]."""
        return np.array(self.model.gravity.linear)

    @property
    def up(self) -> Array:
        """Unit vector against gravity (3,); +z where the model has no gravity."""
        length = float(np.linalg.norm(self.gravity))
        return -self.gravity / length if length > 0 else np.array([0.0, 0.0, 1.0])

    def require_dh(self, purpose: str) -> DHTable:
        """The DH table.

        Raises:
            UnsupportedArmError: the arm has none.
        """
        if self.dh is None:
            raise UnsupportedArmError(f"{self.name}: {purpose} needs a DH table; this arm came as URDF alone")
        return self.dh

    def poses(self, q: Array, at: str | None = None) -> Poses:
        """The arm at configurations ``q`` (n, nq) [rad], looked at in frame ``at`` (default: the tip), by Pinocchio.

        Raises:
            ShapeError: ``q`` is not a finite (n, nq) array.
            UnknownNameError: no such frame.
        """
        return Poses(self, batch(q, self.nq, "q", "rad"), self._frame_id(at), at or self.tip)

    def positions(self, q: Array, at: str | None = None) -> Array:
        """Origin of frame ``at`` (default: the tip) for ``q`` (n, nq) [rad]: (n, 3) [m]."""
        row = self.dh_row(at)
        if self.dh is None or row is None:
            return self.poses(q, at).position
        return self.dh.positions(q, row)

    def sensitivity(self, q: Array, at: str | None = None) -> Array:
        """∂(origin of frame ``at``)/∂parameters for ``q`` (n, nq) [rad]: (n, 3, len(parameters)) [m/unit].

        The closed form of :meth:`DHTable.sensitivity` where there is a DH table, Pinocchio's regressor elsewhere.
        """
        if self.dh is None:
            return self.poses(q, at).placement_sensitivity
        return self.dh.sensitivity(q, self._known_row(at))

    def jacobian(self, q: Array, at: str | None = None) -> Array:
        """∂(origin of frame ``at``)/∂q for ``q`` (n, nq) [rad]: (n, 3, nq) [m/rad]."""
        row = self.dh_row(at)
        if self.dh is None or row is None:
            return self.poses(q, at).jacobian[:, :3]
        return self.dh.jacobian(q, row)

    def perturbed_positions(self, q: Array, errors: Array, at: str | None = None) -> Array:
        """Exact positions under many draws of parameter errors; nothing is linearised.

        Args:
            q: one configuration (1, nq), or one for each draw (m, nq) [rad].
            errors: (m, len(parameters)), added to the parameters [their units].
            at: frame (default: the tip).

        Returns:
            (m, 3) [m].
        """
        q = batch(q, self.nq, "q", "rad")
        errors = batch(errors, len(self.parameters), "errors", "m or rad")
        if len(q) not in (1, len(errors)):
            raise ShapeError(f"q has {len(q)} rows, expected 1 or as many as errors has, {len(errors)}")
        q = np.broadcast_to(q, (len(errors), self.nq))
        if self.dh is None:
            return self._perturbed_by_pinocchio(q, errors, self._frame_id(at))
        return self.dh.positions(q, self._known_row(at), errors.reshape(len(errors), -1, 4))

    def _perturbed_by_pinocchio(self, q: Array, errors: Array, frame: int) -> Array:
        model = self.model.copy()
        nominal = [placement.copy() for placement in self.model.jointPlacements]
        data = model.createData()
        positions = np.empty((len(errors), 3))
        for k, error in enumerate(errors.reshape(len(errors), -1, 6)):
            for joint, step in enumerate(error, start=1):
                shift = pin.SE3(pin.exp3(step[3:]), step[:3])
                model.jointPlacements[joint] = nominal[joint] * shift
            pin.forwardKinematics(model, data, q[k])
            positions[k] = pin.updateFramePlacement(model, data, frame).translation
        return positions

    def _frame_id(self, at: str | None) -> int:
        name = at or self.tip
        return _frame_number(self.model, name)

    def _known_row(self, at: str | None) -> int:
        row = self.dh_row(at)
        if row is None:
            raise UnsupportedArmError(f"{self.name}: frame {at!r} is not one of the DH table")
        return row

    def dh_row(self, at: str | None = None) -> int | None:
        """Number of the DH row whose frame is ``at`` (default: the tip); None for frames that the table does not know.

        Raises:
            UnknownNameError: no such frame.
        """
        if self.dh is None:
            return None
        if at is None or at == self.tip:
            return self.dh.rows
        self._frame_id(at)
        number = at.removeprefix("frame")
        return int(number) if number.isdigit() else None


@dataclass(frozen=True, eq=False)
class Poses:
    """An arm at many configurations, computed by Pinocchio on first use; the arrays are copies, not views of its memory.

    Attributes:
        arm: the arm.
        q: configurations (n, nq) [rad].
        frame_id: Pinocchio's number of the frame looked at.
        at: its name.
    """

    arm: Arm
    q: Array
    frame_id: int
    at: str

    @cached_property
    def placement(self) -> Array:
        """Placement of the frame in the base, (n, 4, 4) [m]."""
        model, data = self.arm.model, self.arm.model.createData()
        placements = np.empty((len(self.q), 4, 4))
        for k, q in enumerate(self.q):
            pin.forwardKinematics(model, data, q)
            placements[k] = pin.updateFramePlacement(model, data, self.frame_id).homogeneous
        return placements

    @property
    def position(self) -> Array:
        """Origin of the frame in the base, (n, 3) [m]."""
        return self.placement[:, :3, 3]

    @cached_property
    def jacobian(self) -> Array:
        """Twist of the frame per joint speed, linear first, ``LOCAL_WORLD_ALIGNED``: (n, 6, nq) [m/rad, rad/rad]."""
        model, data = self.arm.model, self.arm.model.createData()
        jacobians = np.empty((len(self.q), 6, self.arm.nq))
        for k, q in enumerate(self.q):
            jacobians[k] = pin.computeFrameJacobian(model, data, q, self.frame_id, pin.LOCAL_WORLD_ALIGNED).reshape(6, -1)
        return jacobians

    @cached_property
    def placement_sensitivity(self) -> Array:
        """∂position/∂(shift, turn of every joint placement in its own axes): (n, 3, 6 nq) [m/m, m/rad]."""
        model, data = self.arm.model, self.arm.model.createData()
        columns = np.empty((len(self.q), 3, 6 * (model.njoints - 1)))
        for k, q in enumerate(self.q):
            pin.forwardKinematics(model, data, q)
            pin.updateFramePlacement(model, data, self.frame_id)
            columns[k] = pin.computeFrameKinematicRegressor(model, data, self.frame_id, pin.LOCAL_WORLD_ALIGNED)[:3]
        return columns

    def dh_sensitivity(self) -> Array:
        """∂position/∂(a, d, alpha, theta of each row) by the chain rule through the placements: (n, 3, 4 rows).

        The constant part of row i lies in the placement of the next joint, or behind the last joint in the frame itself;
        its derivative is a twist there, carried to the regressor's axes by an adjoint. Independent of the closed form
        of :meth:`DHTable.sensitivity`.

        Raises:
            UnsupportedArmError: the arm has no DH table, or the table does not know the frame.
        """
        dh = self.arm.require_dh("a DH sensitivity")
        row = self.arm._known_row(self.at)
        through_placements, behind_last_joint = _dh_columns(dh, row, self.arm.nq)
        return self.placement_sensitivity @ through_placements + self.placement[:, :3, :3] @ behind_last_joint

    @cached_property
    def gravity_moments(self) -> Array:
        """Moment of the weight of all that hangs beyond each joint, about the joint's origin, base axes: (n, nq, 3) [N·m].

        Raises:
            UnsupportedArmError: no body of the arm has a mass.
        """
        if sum(inertia.mass for inertia in self.arm.model.inertias) == 0.0:
            raise UnsupportedArmError(f"{self.arm.name}: gravity moments need masses; the arm states none")
        model, data = self.arm.model, self.arm.model.createData()
        moments = np.empty((len(self.q), self.arm.nq, 3))
        for k, q in enumerate(self.q):
            pin.centerOfMass(model, data, q, True)
            for joint in range(1, model.njoints):
                if data.mass[joint] == 0.0:  # Pinocchio's centre of nothing is 0/0
                    moments[k, joint - 1] = 0.0
                    continue
                lever = data.oMi[joint].rotation @ data.com[joint]
                moments[k, joint - 1] = np.cross(lever, data.mass[joint] * self.arm.gravity)
        return moments


def _dh_columns(dh: DHTable, row: int, nq: int) -> tuple[Array, Array]:
    """How the DH values up to ``row`` act: on the joint placements, and on the frame behind the last joint.

    Going backwards along the chain, ``to_target`` is the constant transform from the piece at hand to the next joint's
    axes (or to the frame itself); the unit twist of the piece, seen from there, is the column.

    Returns:
        (6 nq, 4 rows) and (3, 4 rows), the latter in the axes of the frame.
    """
    through, behind = np.zeros((6 * nq, 4 * dh.rows)), np.zeros((3, 4 * dh.rows))
    to_target, target = pin.SE3.Identity(), None
    joint = int(dh.moving[:row].sum())
    for i in reversed(range(row)):
        for kind, piece in reversed(_row_pieces(dh, i)):
            if kind is None:  # the joint itself
                target, to_target = joint, pin.SE3.Identity()
                joint -= 1
                continue
            to_target = piece * to_target
            motion = to_target.actInv(_unit_twist(kind))
            if target is None:
                behind[:, 4 * i + KINDS.index(kind)] = motion.linear
            else:
                through[6 * (target - 1) : 6 * target, 4 * i + KINDS.index(kind)] = motion.vector
    return through, behind


def _row_pieces(dh: DHTable, i: int) -> list[tuple[str | None, Any]]:
    """The constant transforms of row i in their order, with the joint, if any, as (None, None)."""
    zero = np.zeros(3)
    theta = ("theta_offset", pin.SE3(pin.utils.rotate("z", dh.theta_offset[i]), zero))
    d = ("d", pin.SE3(np.eye(3), np.array([0.0, 0.0, dh.d[i]])))
    a = ("a", pin.SE3(np.eye(3), np.array([dh.a[i], 0.0, 0.0])))
    alpha = ("alpha", pin.SE3(pin.utils.rotate("x", dh.alpha[i]), zero))
    joint: list[tuple[str | None, Any]] = [(None, None)] if dh.moving[i] else []
    if dh.standard:
        return [theta, *joint, d, a, alpha]
    return [alpha, a, theta, *joint, d]


def _unit_twist(kind: str) -> Any:
    """Motion that a unit of this value makes, in the axes where the value stands."""
    vector = np.zeros(6)
    vector[{"a": 0, "d": 2, "alpha": 3, "theta_offset": 5}[kind]] = 1.0
    return pin.Motion(vector)


def _frame_number(model: Any, name: str) -> int:
    """Number of a frame; of a link and a joint with the same name, which URDF allows, the link (getFrameId would raise).

    Raises:
        UnknownNameError: no such frame; lists the frames.
    """
    same = [number for number, frame in enumerate(model.frames) if frame.name == name]
    if not same:
        raise UnknownNameError("frame", name, [frame.name for frame in model.frames])
    links = [number for number in same if model.frames[number].type == pin.FrameType.BODY]
    return (links or same)[0]


def _serial_part(model: Any, frame: str) -> Any:
    """The chain from the base to ``frame``; other joints (a gripper's fingers) are locked at their neutral place."""
    joint = model.frames[_frame_number(model, frame)].parentJoint
    chain = []
    while joint > 0:
        chain.append(joint)
        joint = model.parents[joint]
    others = [j for j in range(1, model.njoints) if j not in chain]
    model = pin.buildReducedModel(model, others, pin.neutral(model)) if others else model.copy()
    wide = [model.names[j] for j in range(1, model.njoints) if model.joints[j].nq != 1 or model.joints[j].nv != 1]
    if wide:
        raise UnsupportedArmError(
            f"{model.name}: joint {', '.join(wide)} takes more than one number; write it as revolute with wide limits"
        )
    if model.njoints < 2:
        raise UnsupportedArmError(f"{model.name}: no joint moves frame {frame!r}")
    return model


def _placement_parameters(model: Any, shift: float, turn: float) -> tuple[Parameter, ...]:
    axes = [("x", "m"), ("y", "m"), ("z", "m"), ("rx", "rad"), ("ry", "rad"), ("rz", "rad")]
    return tuple(
        Parameter.bounded(f"{axis}{joint}", axis, joint, unit, 0.0, shift if unit == "m" else turn)
        for joint in range(1, model.njoints)
        for axis, unit in axes
    )
