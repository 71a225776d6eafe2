"""Discrepancies: smooth functions at any records, what they act on, and how an arm file has
them.
"""

from __future__ import annotations

import numpy as np
import pytest
import tomli_w
from scipy.spatial.transform import Rotation

from aacmm_pin._support.arrays import Array
from aacmm_pin.accuracy.tip_sensitivity import ErrorSources
from aacmm_pin.arm import Arm
from aacmm_pin.effects import ErrorModel
from aacmm_pin.effects.conditions import Conditions
from aacmm_pin.effects.smooth_discrepancy import (
    Bumps,
    Carrier,
    Cosines,
    Discrepancy,
    Moment,
    Smooth,
    Waves,
)
from aacmm_pin.effects.state import State
from aacmm_pin.errors import ArmFileError, MissingConditionError
from tests.oracle import close, gravity_torques, placements, with_dh_errors

pytestmark = pytest.mark.fast

TIME = Cosines("time", (0.0, 100.0, 400.0), (0.5, 5.0, 9.5), 10, 2)
PLACES = Bumps(((0.1, 0.2, 0.3), (-0.3, 0.4, 0.5)), 0.4)
WAVES = (Waves("joint 2", constant=True), Waves("joint 4", less=(0.25, -0.5)))
N = 7
LONG = [2, 4, 5]
"""Rows, from 0, of the arm's bodies longer than 0.15 m."""


def records(arm: Arm, rng: np.random.Generator) -> tuple[Array, Conditions]:
    low, high = arm.limits.T
    return rng.uniform(low, high, (N, arm.nq)), Conditions(N, time=rng.uniform(-100.0, 500.0, N))


def one(carrier: str, *functions: Smooth) -> Discrepancy:
    """Its coefficients are 1, 2, 3 … times 1e-6."""
    counts = {TIME: 3, PLACES: 2, WAVES[0]: 3}
    size = len(Carrier(carrier).quantities)
    for each in functions:
        size *= counts.get(each, 1 if isinstance(each, Moment) else 2)
    values = 1e-6 * (1.0 + np.arange(size))
    return Discrepancy(
        "something",
        Carrier(carrier),
        functions,
        size,
        values=tuple(values),
        u=tuple(0.1 * values),
    )


GEAR = one("angle 3", Waves("joint 3", order=4), Moment("joint 3", (1.0, -2.0, 0.5)))


def by_hand(functions: tuple[Smooth, ...], tip: Array, q: Array, time: Array) -> Array:
    """The functions of this file, once more (n, m)."""
    if functions == (TIME,):
        below = np.interp(time, [0.0, 100.0, 400.0], [0.05, 0.5, 0.95])
        return np.stack([np.cos(k * np.pi * below) for k in range(3)], axis=1)
    if functions == (PLACES,):
        return np.stack(
            [np.exp(-(np.sum((tip - c) ** 2, axis=1)) / 0.32) for c in PLACES.centres_si], axis=1
        )
    own = [np.ones(len(q)), np.cos(q[:, 1]), np.sin(q[:, 1])]
    others = (np.cos(q[:, 3]) - 0.25, np.sin(q[:, 3]) + 0.5)
    return np.stack([f * g for f in own for g in others], axis=1)


@pytest.mark.parametrize("carrier", ["room", "frame", "target", "lengths", "before 4", "angle 4"])
@pytest.mark.parametrize("functions", [(TIME,), (PLACES,), WAVES], ids=["time", "place", "waves"])
def test_moves_the_tip_as_pinocchio_says(sino6, rng, carrier, functions):
    q, conditions = records(sino6, rng)
    effect = one(carrier, *functions)
    frames = placements(sino6, q)
    tip, time = frames[:, -1, :3, 3], conditions.require("time", "test")
    sizes = by_hand(functions, tip, q, time) @ np.reshape(
        effect.values, (-1, len(effect.carrier.quantities))
    )
    if carrier == "angle 4":
        turned = q.copy()
        turned[:, 3] += sizes[:, 0]
        wanted = sino6.poses(turned).position
    elif carrier == "frame":
        shift, turn = sizes[:, :3], sizes[:, 3:]
        wanted = Rotation.from_rotvec(turn).apply(tip) + shift + 0.5 * np.cross(turn, shift)
    else:
        axes = {"target": frames[:, -1, :3, :3], "before 4": frames[:, 3, :3, :3]}.get(
            carrier, np.eye(3)
        )
        wanted = tip + (
            tip * sizes if carrier == "lengths" else np.squeeze(axes @ sizes[:, :, None], axis=2)
        )
    model = ErrorModel(sino6, [effect])
    close(model.predict(q, conditions), wanted, 1e-12)
    close(
        model.sensitivity(q, conditions)[:, :, -effect.size :] @ effect.values, wanted - tip, 1e-7
    )


@pytest.mark.parametrize(("carrier", "grow"), [("tubes", LONG), ("tube 5", [4])])
def test_tubes_grow_as_longer_ones_do(sino6, rng, carrier, grow):
    q, conditions = records(sino6, rng)
    effect = Discrepancy("something", Carrier(carrier), (), 1, values=(1e-6,))
    errors = np.zeros((6, 4))
    errors[grow, :2] = 1e-6 * sino6.dh.values()[grow, :2]
    longer = with_dh_errors(sino6.file, errors)
    close(ErrorModel(sino6, [effect]).predict(q, conditions), longer.positions(q))


@pytest.mark.parametrize("row", [1, 2, 3, 5])
def test_moment_is_the_torque_that_pinocchio_says(sino6, rng, row):
    q, conditions = records(sino6, rng)
    state = State(sino6, q, conditions, sino6.chain.tip)
    of = f"joint {row}"
    close(Moment(of).values(state)[:, 0], gravity_torques(sino6, q)[:, row - 1], 1e-9)
    own = np.stack([np.ones(N), np.cos(q[:, row - 1]), np.sin(q[:, row - 1])], axis=1)
    rest = Moment.beyond_own_angle(of, state).values(state)
    close(own.T @ rest, 0.0, 1e-9)


def test_ranks_are_the_same_at_new_records(rng):
    few = rng.permutation(np.repeat([3.0, 1.0, 7.0], [4, 2, 6]))
    below = np.array([1.0, 4.0, 9.0])[np.searchsorted([1.0, 3.0, 7.0], few)] / 12.0
    wanted = np.cos(np.pi * np.arange(4) * below[:, None])
    close(Cosines.over("time", few, 3).of_values(few), wanted, 1e-15)
    many = rng.normal(size=1000)
    cosines, ranks = Cosines.over("time", many, 5), (np.argsort(np.argsort(many)) + 0.5) / 1000.0
    assert (
        np.abs(cosines.of_values(many) - np.cos(np.pi * np.arange(6) * ranks[:, None])).max() < 0.1
    )


@pytest.mark.parametrize("effect", [one("before 3", TIME), GEAR])
def test_arm_file_brings_it_back(sino6, rng, tmp_path, effect):
    q, conditions = records(sino6, rng)
    model, path = (
        ErrorModel(sino6, ["encoder_gain:3,gain=1e-4", effect]),
        tmp_path / "extended.toml",
    )
    model.save(path)
    again = ErrorModel.load(path)
    assert again.effects[0] == model.effects[0]
    assert [p.name for p in again.parameters] == [p.name for p in model.parameters]
    close(again.predict(q, conditions), model.predict(q, conditions), 1e-9)
    again.save(tmp_path / "again.toml")
    assert (tmp_path / "again.toml").read_bytes() == path.read_bytes()


def test_of_an_arm_that_came_as_urdf(robot_file, rng, tmp_path):
    """The finger of Panda slides, and is off by what the joint before it does."""
    arm = Arm.from_urdf(robot_file("panda.urdf"), "panda_leftfinger")
    effect = one("slide 8", Waves("joint 7"))
    ErrorModel(arm, [effect]).save(tmp_path / "extended.toml")
    model, q = ErrorModel.load(tmp_path / "extended.toml"), rng.uniform(-0.1, 0.1, (N, 8))
    moved = q.copy()
    moved[:, 7] += np.stack([np.cos(q[:, 6]), np.sin(q[:, 6])], axis=1) @ effect.values
    close(model.predict(q), arm.poses(moved).position, 1e-12)


COSINES = {
    "kind": "cosines",
    "of": "time",
    "at_si": [0.0, 60.0],
    "below": [0.5, 9.5],
    "records": 10,
    "count": 1,
}
ENTRY = {
    "depends_on": "joint 2 × time",
    "parts": [
        {
            "acts_on": "angle 2",
            "functions": [
                {"kind": "waves", "of": "joint 2"},
                COSINES,
            ],
        }
    ],
    "values_si": [1e-5, 2e-5, 3e-5, 4e-5],
}
CONSTANT = {"acts_on": "angle 2", "functions": []}
MISTAKES: list[tuple[dict[str, object], str, str]] = [
    ({"values_si": [1e-5, 2e-5, 3e-5, 1.0]}, "discrepancy[1]", "expected at most"),
    ({"colour": "red"}, "discrepancy[1].colour", "depends_on"),
    (
        {"parts": [{"acts_on": "angle 9", "functions": []}], "values_si": [1e-5]},
        "discrepancy[1]",
        "no row 9",
    ),
    (
        {"parts": [{"acts_on": "elbow", "functions": []}], "values_si": [1e-5]},
        "discrepancy[1]",
        "expected room",
    ),
    ({"parts": [CONSTANT]}, "discrepancy[1]", "4 values; expected 1"),
    ({"parts": [CONSTANT, CONSTANT]}, "discrepancy[1].parts", "1"),
]
OF_FUNCTIONS: list[tuple[dict[str, object], str]] = [
    ({"kind": "splines"}, "expected tags"),
    (COSINES | {"at_si": [1, 0]}, "ascending"),
]


def test_each_mistake_in_a_file_is_named(sino6, tmp_path):
    content, path = (
        ErrorModel(sino6).file().model_dump(mode="json", by_alias=True, exclude_none=True),
        tmp_path / "bad.toml",
    )
    parts = [
        ({"parts": [{"acts_on": "angle 2", "functions": [odd]}]}, "discrepancy[1]", word)
        for odd, word in OF_FUNCTIONS
    ]
    for change, key, word in [*MISTAKES, *parts]:
        path.write_text(
            tomli_w.dumps(content | {"discrepancy": [ENTRY | change]}), encoding="utf-8"
        )
        with pytest.raises(ArmFileError) as caught:
            ErrorModel.load(path)
        assert (caught.value.key, word in str(caught.value)) == (key, True), str(caught.value)
    path.write_text(tomli_w.dumps(content | {"discrepancy": [ENTRY]}), encoding="utf-8")
    assert ErrorModel.load(path).effects[0].needs == ("time",)


def test_records_without_its_condition_and_outside_its_range(sino6, rng):
    q, conditions = records(sino6, rng)
    model = ErrorModel(sino6, [one("room", TIME)])
    with pytest.raises(MissingConditionError):
        model.predict(q)
    outside = int(np.sum((conditions.time < 0.0) | (conditions.time > 400.0)))  # type: ignore[operator]
    (line,) = model.effects[0].validity_notes(conditions)
    assert (line.code, line.data["records"]) == ("outside_fitted_range", outside)
    assert ErrorSources.of(model, None, None, q, None).not_included == (model.effects[0].label,)
