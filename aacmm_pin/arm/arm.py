"""Arms: a DH table, a Pinocchio model, or both."""

from __future__ import annotations

import os
import textwrap
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from aacmm_pin._support import plausible
from aacmm_pin._support.arrays import Array, batch, unit_vector
from aacmm_pin._support.display import Shown
from aacmm_pin._support.units import MM
from aacmm_pin.arm import chain
from aacmm_pin.arm.chain import Chain
from aacmm_pin.arm.couplings import Coupling, Drive, Mimic, coupling_matrix
from aacmm_pin.arm.dh import DHTable
from aacmm_pin.arm.example_robots import EXAMPLE_ROBOTS, urdf_of_robot
from aacmm_pin.arm.file import (
    ArmFile,
    Covariance,
    Urdf,
    UrdfArmFile,
    UrdfJoint,
    calibrated,
    read_arm_file,
)
from aacmm_pin.arm.parameter import Parameter
from aacmm_pin.arm.pinocchio_model import (
    chain_of,
    frame_number,
    joint_axes,
    onto_z,
    serial_part,
)
from aacmm_pin.errors import (
    AacmmError,
    ArmFileError,
    UnknownNameError,
    UnsupportedArmError,
)

if TYPE_CHECKING:
    from aacmm_pin.arm.poses import Poses

MOST_UNEXPLAINED = 1000
"""Characters; the text may list many groups of records."""


@dataclass(frozen=True, eq=False)
class Arm(Shown):
    """A serial arm with its Pinocchio model and, if available, its DH table.

    Attributes:
        name: in titles and messages.
        model: of Pinocchio; do not change it.
        tip: frame whose origin is the tip.
        limits: joint limits ``(nq, 2)`` [rad].
        parameters: geometric parameters, in the order of :meth:`sensitivity`.
        dh: None for an arm from a URDF.
        encoder_noise: standard uncertainty of one reading ``(nq,)`` [rad]; None if not stated.
        stylus_axis: unit vector in the tip frame ``(3,)``; None if not stated.
        source: origin of the numbers.
        reference_temperature: of the stated lengths [°C].
        file: content of the arm file.
        covariance: of parameters from a calibration, or None.
        nominal: of an arm from a URDF, the model without corrections; otherwise None.
        couplings: see :meth:`with_couplings`.
        mimics: joints of a URDF that follow other joints, and have no columns in ``q``.
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
    reference_temperature: float = 20.0
    file: ArmFile | UrdfArmFile | None = None
    covariance: Covariance | None = None
    nominal: Any = None
    couplings: tuple[Coupling, ...] = ()
    mimics: tuple[Mimic, ...] = ()

    def __repr__(self) -> str:
        table = "no DH table"
        if self.dh is not None:
            table = f"{self.dh.rows} {self.dh.convention} rows"
        return f"Arm({self.name!r}, {self.nq} joints, {table}, tip {self.tip!r})"

    @property
    def without_uncertainty(self) -> tuple[str, ...]:
        """Parameters without stated uncertainty, which count as exact."""
        exact = (p for p in self.parameters if p.half_width is None and p.u == 0)
        return tuple(parameter.name for parameter in exact)

    @property
    def unexplained(self) -> str:
        """The structure that the last calibration or diagnosis did not explain."""
        return "" if self.file is None else self.file.unexplained

    @property
    def tip_on_target(self) -> bool:
        """True if a calibration moved the tip to the estimated place of the target."""
        return self.file is not None and self.file.tip_on_target

    @staticmethod
    def load(name_or_path: str | Path) -> Arm:
        """Load a bundled arm (``sino6``) or example robot (``ur5``) by name, or an arm file by
        path.

        Raises:
            UnknownNameError: unknown name.
            ArmFileError: the file is invalid; see :meth:`from_file`.
            AacmmError: the package of example robots is missing.
        """
        name = str(name_or_path)
        if name in EXAMPLE_ROBOTS:
            return Arm.from_urdf(name)
        return Arm.from_file(read_arm_file(name_or_path), name)

    @staticmethod
    def from_file(arm: ArmFile | UrdfArmFile, path: str = "") -> Arm:
        """Build the arm of a validated arm file, named ``path`` in messages.

        Raises:
            ArmFileError: its URDF is missing, has changed, or has other joints.
        """
        if isinstance(arm, UrdfArmFile):
            return _of_urdf_file(arm, path or arm.name)
        from aacmm_pin.arm.dh_to_urdf import urdf_text

        model = pin.buildModelFromXML(urdf_text(arm))
        model.gravity.linear = np.array(arm.gravity_m_s2)
        return _of_file(
            arm,
            model=model,
            tip="tip",
            limits=arm.limits,
            parameters=arm.dh_parameters(),
            dh=arm.dh,
            encoder_noise=arm.encoder_noise,
        )

    @staticmethod
    def from_urdf(
        path: str | Path,
        frame: str = "",
        *,
        translation_half_width: float = 0.0,
        rotation_half_width: float = 0.0,
    ) -> Arm:
        """Load an arm with revolute, continuous or prismatic joints from a URDF file.

        A ``continuous`` joint gets limits of ±2π. Joints that do not move ``frame`` (gripper
        fingers) stay at zero. Joints that mimic others have no column in ``q``. The parameters are
        three translations and three rotations of every joint placement, in its own axes.

        Args:
            path: URDF file (meshes are not needed), or the name of a robot in
                :data:`aacmm_pin.arm.example_robots.EXAMPLE_ROBOTS`.
            frame: link or frame whose origin is the tip; example robots have a default.
            translation_half_width, rotation_half_width: of each placement [m, rad]; 0 states no
                uncertainty.

        Raises:
            ArmFileError: the file cannot be read, is no URDF, or is implausible.
            UnsupportedArmError: a joint has more than one coordinate (planar, floating), or mimics
                a joint that does not move ``frame``.
            UnknownNameError: the frame is unknown; lists all frames.
        """
        if str(path) in EXAMPLE_ROBOTS:
            frame = frame or EXAMPLE_ROBOTS[str(path)][1]
            path = urdf_of_robot(str(path))
        from aacmm_pin.arm.urdf_check import read_urdf  # which loads lxml

        robot, sha256, followers = read_urdf(path)
        model, mimics = serial_part(robot, frame, followers)
        arm = Arm.from_model(
            model,
            frame,
            source=str(path),
            translation_half_width=translation_half_width,
            rotation_half_width=rotation_half_width,
        )
        # A pipe has no name for others to read it by.
        file = os.path.realpath(path) if os.path.isfile(path) else ""
        return _corrected(model, _with_urdf(arm.urdf_file, file=file, sha256=sha256), mimics)

    @staticmethod
    def from_model(
        model: Any,
        frame: str,
        *,
        source: str = "",
        translation_half_width: float = 0.0,
        rotation_half_width: float = 0.0,
    ) -> Arm:
        """Build an arm from a Pinocchio model; see :meth:`from_urdf` for arguments and errors."""
        plausible.SHIFT_HALF_WIDTH.check(translation_half_width, "translation_half_width")
        plausible.TURN_HALF_WIDTH.check(rotation_half_width, "rotation_half_width")
        model, _ = serial_part(model, frame)
        # Not validated: a name that no arm file could have matters when one is written.
        urdf = Urdf.model_construct(
            file="",
            frame=frame,
            translation_half_width_mm=translation_half_width / MM,
            rotation_half_width_rad=rotation_half_width,
        )
        file = UrdfArmFile.model_construct(
            schema_="aacmm-pin/arm/1",
            name=model.name,
            source=source,
            gravity_m_s2=tuple(model.gravity.linear.tolist()),
            urdf=urdf,
        )
        return _corrected(model, file)

    @property
    def urdf_file(self) -> UrdfArmFile:
        """The arm file; its path is empty for a Pinocchio model or a pipe.

        Raises:
            UnsupportedArmError: the arm has a DH table.
        """
        if not isinstance(self.file, UrdfArmFile):
            raise UnsupportedArmError(
                f"{self.name}: this arm has a DH table; expected an arm from a URDF"
            )
        return self.file

    @property
    def uncorrected(self) -> Arm:
        """The arm with placements and tip as its URDF states them.

        Raises:
            UnsupportedArmError: the arm has a DH table.
        """
        update: dict[str, Any] = {"joints": [], "covariance": None, "tip_on_target": False}
        return _corrected(self.nominal, self.urdf_file.model_copy(update=update), self.mimics)

    def with_placements(
        self, steps: Array, covariance: Covariance | None, *, exact: bool = False
    ) -> Arm:
        """Return the arm with every placement moved by a twist in its own axes.

        Args:
            steps: v, then ω ``(nq, 6)`` [m, rad].
            covariance: of the placements.
            exact: set all half-widths to zero.
        """
        steps = batch(steps, 6, "steps", "m, rad")
        joints = []
        for joint, before, step in zip(
            self.urdf_file.joints, self.urdf_file.corrections, steps, strict=True
        ):
            total = step if not before.any() else pin.log6(_motion(before) * _motion(step)).vector
            corrections = {
                "shift_mm": tuple((total[:3] / MM).tolist()),
                "turn_rad": tuple(total[3:].tolist()),
            }
            joints.append(joint.model_copy(update=corrections))
        file = self.urdf_file.model_copy(update={"joints": joints, "covariance": covariance})
        if exact:
            file = _with_urdf(file, translation_half_width_mm=0.0, rotation_half_width_rad=0.0)
        return _corrected(self.nominal, file, self.mimics)

    def with_encoder_noise(self, noise: Array) -> Arm:
        """Return the arm, and its file, with these standard uncertainties of one reading ``(nq,)``
        [rad].
        """
        if self.file is None:
            return replace(self, encoder_noise=noise)
        of_joint = iter(noise[self.chain.drive.leader].tolist())
        rows = []
        for row in self.file.joints:
            moves = not getattr(row, "fixed", False)
            rows.append(row.with_encoder_noise(next(of_joint)) if moves else row)
        return replace(
            self, encoder_noise=noise, file=self.file.model_copy(update={"joints": rows})
        )

    def with_couplings(self, *couplings: tuple[int, int, float]) -> Arm:
        """Return the arm with joint angles that depend on several readings.

        A joint angle is the sum of ratios times readings. The ratio of its own reading is 1, unless
        a coupling with ``of = joint`` states another. ``(3, 2, -1.0)`` makes angle 3 reading 3
        minus reading 2. The arm file changes too.

        Args:
            couplings: ``joint``, ``of`` and ``ratio`` of each, with row numbers from 1; they
                replace all former ones.

        Raises:
            AacmmError: invalid, or the readings do not determine all angles.
        """
        entries = [Coupling(joint=joint, of=of, ratio=ratio) for joint, of, ratio in couplings]
        try:
            coupling_matrix(entries, self.chain.moving_rows())
        except ValueError as error:
            raise AacmmError(f"{self.name}: {error}") from None
        file = self.file
        if file is not None:
            file = file.model_copy(update={"couplings": entries})
        return replace(self, couplings=tuple(entries), file=file)

    @cached_property
    def coupling_matrix(self) -> Array:
        """The derivative of the joint angles by the readings, ``(nq, nq)``."""
        return coupling_matrix(self.couplings, self.chain.moving_rows())

    def joint_angles(self, readings: Array) -> Array:
        """Joint angles from readings ``(n, nq)``: ``(n, nq)`` [rad; m for prismatic joints].

        Raises:
            ShapeError: ``readings`` is not a finite ``(n, nq)`` array.
        """
        readings = batch(readings, self.nq, "readings", "rad or another unit")
        return readings @ self.coupling_matrix.T if self.couplings else readings

    def readings(self, q: Array) -> Array:
        """Readings at joint angles ``(n, nq)``: ``(n, nq)`` [rad; m for prismatic joints]."""
        if not self.couplings:
            return q
        return np.asarray(np.linalg.solve(self.coupling_matrix, q.T).T)

    def by_readings(self, by_angles: Array) -> Array:
        """Convert a derivative by the joint angles ``(…, nq)`` to a derivative by the readings."""
        return by_angles @ self.coupling_matrix if self.couplings else by_angles

    def with_unexplained(self, text: str) -> Arm:
        """Return the arm whose file states this unexplained structure, perhaps shortened."""
        short = textwrap.shorten(text, MOST_UNEXPLAINED, placeholder=" …")
        return replace(
            self,
            file=None if self.file is None else self.file.model_copy(update={"unexplained": short}),
        )

    @property
    def nq(self) -> int:
        """The number of joints, without joints that follow others."""
        return len(self.limits)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """All joints from base to tip, including joints that follow others."""
        return tuple(self.model.names[1:])

    @property
    def joint_axes(self) -> Array:
        """The axis of each joint in the axes of its placement, ``(nq, 3)``."""
        return joint_axes(self.model)

    @property
    def gravity(self) -> Array:
        """The acceleration of gravity in the base frame, ``(3,)`` [m/s²]."""
        return np.array(self.model.gravity.linear)

    @property
    def up(self) -> Array:
        """The unit vector against gravity, ``(3,)``; +z if the model has no gravity."""
        length = float(np.linalg.norm(self.gravity))
        return -self.gravity / length if length > 0 else np.array([0.0, 0.0, 1.0])

    def require_dh(self, purpose: str, joints: int = 0, *, revolute: bool = False) -> DHTable:
        """Return the DH table, or refuse the arm.

        Args:
            purpose: what needs it, for the message.
            joints: first rows that must have joints.
            revolute: all joints must be revolute.

        Raises:
            UnsupportedArmError: no DH table, a row missing or rigid, or a prismatic joint.
        """
        if self.dh is None:
            first = f" whose first {joints} rows are joints" if joints else ""
            raise UnsupportedArmError(
                f"{self.name} has no DH table; {purpose} needs a DH table{first}; to make the "
                "table of a URDF, run aacmm-pin urdf --to-dh"
            )
        if self.dh.rows < joints or not self.dh.moving[:joints].all():
            raise UnsupportedArmError(
                f"{self.name}: this arm has {self.nq} joints in {self.dh.rows} DH rows; {purpose} "
                f"needs a joint in each of the first {joints} rows"
            )
        if revolute and self.dh.slides.any():
            row = int(np.argmax(self.dh.slides)) + 1
            raise UnsupportedArmError(
                f"{self.name}: joint {row} is prismatic; {purpose} needs revolute joints"
            )
        return self.dh

    @cached_property
    def chain(self) -> Chain:
        """The kinematics of the arm."""
        if self.dh is None:
            return chain_of(self.model, self.tip, self.mimics)
        return self.dh.chain

    @cached_property
    def masses(self) -> Array | None:
        """The mass of the body after each ``axis``, ``(rows,)`` [kg]; None without masses."""
        masses = np.array([inertia.mass for inertia in self.model.inertias.tolist()[1:]])
        return self._over_rows(masses) if masses.any() else None

    @cached_property
    def centres_of_mass(self) -> Array:
        """The centre of mass of the body after each ``axis``, in the axes of that place ``(rows,
        3)`` [m]; zero without mass.
        """
        centres = np.zeros((len(self.chain.slides), 3))
        for joint, body in enumerate(self.model.inertias.tolist()[1:]):
            if body.mass > 0.0:
                centres[joint] = self._in_axes_of_place(joint, body.lever)
        return self._over_rows(centres)

    def foot(self, row: int) -> int:
        """Return the place on the joint axis where the body of ``row`` begins.

        In modified DH it is before d of the row; ``axis(row)`` is after.
        """
        if self.dh is None or self.dh.standard:
            return chain.axis(row)
        return chain.end(row - 1)

    def _over_rows(self, of_joints: Array) -> Array:
        """Values of joints as those of rows, zero for rigid ones."""
        values = np.zeros((self.chain.rows, *of_joints.shape[1:]))
        values[np.array(self.chain.joint_rows()) - 1] = of_joints
        return values

    def place(self, at: str | None = None) -> int:
        """Return the number of the chain's place at the origin of frame ``at``; default the tip.

        Raises:
            UnknownNameError: unknown frame.
            UnsupportedArmError: not the tip, and in no DH table.
        """
        if at is None or at == self.tip:
            return self.chain.tip
        frame_number(self.model, at)
        dh = self.require_dh(f"looking at frame {at!r}")
        number = at.removeprefix("frame")
        if not number.isdigit():
            raise UnsupportedArmError(
                f"{self.name}: frame {at!r} is not in the DH table; expected frame1 to "
                f"frame{dh.rows}"
            )
        return dh.place(int(number))

    def poses(self, q: Array, at: str | None = None) -> Poses:
        """Placements of frame ``at`` (default the tip) at ``q`` ``(n, nq)`` [rad], by
        Pinocchio.

        Raises:
            ShapeError: ``q`` is not a finite ``(n, nq)`` array.
            UnknownNameError: unknown frame.
        """
        from aacmm_pin.arm.poses import Poses

        angles = self.chain.drive.angles(batch(q, self.nq, "q", "rad"))
        return Poses(self.model, angles, frame_number(self.model, at or self.tip))

    def positions(self, q: Array, at: str | None = None) -> Array:
        """The origin of frame ``at`` (default the tip) at ``q`` ``(n, nq)`` [rad]: ``(n, 3)``
        [m].
        """
        return self._chain_to(at).positions(batch(q, self.nq, "q", "rad"))

    def sensitivity(self, q: Array, at: str | None = None) -> Array:
        """∂(origin of frame ``at``)/∂parameters at ``q`` ``(n, nq)`` [rad]: ``(n, 3, p)`` [m/unit].

        Columns follow :attr:`parameters`; formulas: :mod:`aacmm_pin.arm.chain`.
        """
        return self._chain_to(at).position_and_sensitivity(batch(q, self.nq, "q", "rad"))[1]

    def jacobian(self, q: Array, at: str | None = None) -> Array:
        """∂(origin of frame ``at``)/∂q at ``q`` ``(n, nq)`` [rad]: ``(n, 3, nq)`` [m/rad]."""
        return self._chain_to(at).position_and_jacobian(batch(q, self.nq, "q", "rad"))[1]

    def _chain_to(self, at: str | None) -> Chain:
        """The chain whose tip is the origin of frame ``at``."""
        place = self.place(at)
        return self.chain if place == self.chain.tip else self.chain.cut(place)

    def _in_axes_of_place(self, joint: int, point: Array) -> Array:
        """A point (3,) [m] of the frame of a joint (from 0), in the axes of its place of the chain:
        z along the joint axis, and in modified DH the origin before d.
        """
        in_place = onto_z(self.joint_axes[joint]).T @ point
        if self.dh is not None and not self.dh.standard:
            in_place[2] -= self.dh.d[self.dh.moving][joint]
        return in_place


def _of_urdf_file(file: UrdfArmFile, path: str) -> Arm:
    from aacmm_pin.arm.urdf_check import read_urdf  # which loads lxml

    urdf = file.urdf
    if not os.path.exists(urdf.file):
        raise ArmFileError(
            path,
            "urdf.file",
            f"{urdf.file}: no such file; expected a URDF, with a path relative to the folder of "
            f"{path}",
        )
    model, sha256, followers = read_urdf(urdf.file)
    if urdf.sha256 not in (None, sha256):
        raise ArmFileError(
            path,
            "urdf.sha256",
            f"{urdf.file} was changed and has the SHA-256 {sha256}; expected {urdf.sha256}; make "
            f"the file of {file.name} again",
        )
    try:
        nominal, mimics = serial_part(model, urdf.frame, followers)
    except (UnknownNameError, UnsupportedArmError) as error:
        raise ArmFileError(path, "urdf.frame", str(error)) from None
    names = list(nominal.names[1:])
    stated = [joint.name for joint in file.joints]
    if stated not in ([], names):
        raise ArmFileError(
            path,
            "joints",
            f"{', '.join(stated)}; expected the joints that move {urdf.frame!r}, which are "
            f"{', '.join(names)}",
        )
    try:
        coupling_matrix(file.couplings, (Drive.of(nominal.nq, mimics).independent + 1).tolist())
    except ValueError as error:
        raise ArmFileError(path, "couplings", str(error)) from None
    return _corrected(nominal, _with_urdf(file, sha256=sha256), mimics)


def _corrected(nominal: Any, file: UrdfArmFile, mimics: tuple[Mimic, ...] = ()) -> Arm:
    if not file.joints:
        joints = [UrdfJoint.model_construct(name=name) for name in nominal.names[1:]]
        file = file.model_copy(update={"joints": joints})
    drive = Drive.of(nominal.nq, mimics)
    noise = file.encoder_noise
    model = nominal.copy()
    for joint, twist in enumerate(file.corrections, start=1):
        model.jointPlacements[joint] = nominal.jointPlacements[joint] * _motion(twist)
    model.gravity.linear = np.array(file.gravity_m_s2)
    half_widths = {"m": file.urdf.translation_half_width_mm * MM}
    half_widths["rad"] = file.urdf.rotation_half_width_rad
    parameters = []
    for joint in range(1, model.njoints):
        for kind in ("x", "y", "z", "rx", "ry", "rz"):
            unit = "rad" if "r" in kind else "m"
            name = f"{kind}{joint}"
            parameters.append(Parameter.bounded(name, kind, joint, unit, 0.0, half_widths[unit]))
    limits = np.column_stack([model.lowerPositionLimit, model.upperPositionLimit])
    return _of_file(
        file,
        model=model,
        tip=file.urdf.frame,
        limits=drive.limits(limits),
        parameters=calibrated(parameters, file.covariance),
        encoder_noise=None if noise is None else noise[drive.independent],
        nominal=nominal,
        mimics=mimics,
    )


def _of_file(file: ArmFile | UrdfArmFile, **fields: Any) -> Arm:
    axis = None
    if file.stylus is not None:
        axis = unit_vector(file.stylus.axis, "the axis of the stylus")
    return Arm(
        name=file.name,
        stylus_axis=axis,
        source=file.source,
        reference_temperature=file.reference_temperature_c,
        file=file,
        covariance=file.covariance,
        couplings=tuple(file.couplings),
        **fields,
    )


def _motion(twist: Array) -> Any:
    return pin.SE3(chain.exp(twist[None])[0])


def _with_urdf(of: UrdfArmFile, **changed: Any) -> UrdfArmFile:
    return of.model_copy(update={"urdf": of.urdf.model_copy(update=changed)})


GivenArm = Arm | str | Path
"""An arm, or its bundled name or the path of its file."""


def as_arm(given: object, name: str = "arm") -> Arm:
    """An arm, given itself, by name, or by path."""
    if isinstance(given, Arm):
        return given
    if isinstance(given, str | Path):
        return Arm.load(given)
    held = " (use model.arm)" if isinstance(getattr(given, "arm", None), Arm) else ""
    raise AacmmError(
        f"{name} is of type {type(given).__name__}; expected an Arm, or the name or path of an "
        f"arm{held}"
    )
