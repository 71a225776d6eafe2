"""Families of files that are hard for a diagnosis, each drawn from a seed: :func:`family_file`.

Files of one family have one thing in common that those of :mod:`blind.regimes` have seldom or
never: structure that no cause describes, noise that nobody states, postures that are held for
several records, many causes, causes that imitate others, payloads, or nothing.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from blind.chains import Chain
from blind.regimes import RegimeFile, draw_regime, regime_file

Given = dict[str, Any]
Places = tuple[tuple[str, int | None], ...]

STRUCTURES = (
    ("joint_product", "other_joint"),
    ("tip_field",),
    ("loaded_gear",),
    ("branch",),
    ("column", "humidity", "operator"),
)
"""Kinds outside the library, each group as likely as the next."""
STRUCTURE_SIZES = (0.5, 1.0, 2.0)
"""Of the noise at the tip."""
COLUMNS = ("humidity_pct", "operator")
ARMS = ("sino6", "standard-dh", "modified-dh", "ur5")
PLAIN: Given = {
    "noise_stated": "all",
    "outliers": 0.0,
    "own_u": False,
    "torque": False,
    "masses": True,
}


def family_file(family: str, seed: int, **given: Any) -> RegimeFile:
    """The file of a seed in a family of :data:`FAMILIES`; what is given is not drawn."""
    rng = np.random.default_rng([seed, zlib.crc32(family.encode())])
    return regime_file(seed, **FAMILIES[family](rng, seed) | given)


def regimes(rng: np.random.Generator, seed: int) -> Given:
    """Files with arms, noise and records as in workshops, and with up to two hidden causes."""
    return {}


def outside(rng: np.random.Generator, seed: int) -> Given:
    """Files with one hidden cause, and one error that the library lacks. The classes state the size
    of the error that the library lacks.
    """
    groups = STRUCTURES[seed // len(STRUCTURE_SIZES) % len(STRUCTURES)]
    kind = str(rng.choice(groups))
    of_column = {"column": COLUMNS[0], "humidity": COLUMNS[0], "operator": COLUMNS[1]}
    noted = COLUMNS if rng.uniform() < 0.5 else tuple(filter(None, [of_column.get(kind)]))
    return PLAIN | {
        "arm": str(rng.choice(ARMS)),
        "evidence": str(rng.choice(["free", "target", "markers", "seats"], p=[0.7, 0.1, 0.1, 0.1])),
        "records": _records(rng, 100, 300),
        "environment": True,
        "approaches": kind != "branch" and bool(rng.uniform() < 0.5),
        "noted": noted,
        "faults": 1,
        "size": _size(rng),
        "structure": kind,
        "structure_size": STRUCTURE_SIZES[seed % len(STRUCTURE_SIZES)],
    }


def outside_alone(rng: np.random.Generator, seed: int) -> Given:
    """The structure without a cause."""
    return outside(rng, seed) | {"faults": 0}


def noise_not_stated(rng: np.random.Generator, seed: int) -> Given:
    """Files with up to two hidden causes, and without stated noise."""
    return {
        "noise_stated": "none",
        "records": _records(rng, 60, 400),
        "faults": int(rng.integers(3)),
    }


def held_postures(rng: np.random.Generator, seed: int) -> Given:
    """Files with several records of each posture. The records of one posture share an error. Half
    of the files have a hidden cause. Half of the files state the noise.
    """
    held, postures = int(rng.integers(3, 6)), int(rng.integers(40, 101))
    return PLAIN | {
        "arm": str(rng.choice(ARMS)),
        "evidence": str(rng.choice(["free", "target"], p=[0.8, 0.2])),
        "records": held * postures,
        "held": held,
        "scattered": bool(rng.uniform() < 0.5),
        "noise_stated": ("all", "none")[seed // 2 % 2],
        "faults": seed % 2,
        "size": _size(rng),
        "structure": "posture",
        "structure_size": float(np.exp(rng.uniform(np.log(0.5), np.log(2.0)))),
        "commanded": bool(rng.uniform() < 0.5),
        "wobble": float(rng.choice([0.0, 2e-3, 5e-3])),
    }


def many_causes(rng: np.random.Generator, seed: int) -> Given:
    """Files with four to six hidden causes at different joints."""
    return PLAIN | {
        "arm": str(rng.choice(ARMS)),
        "evidence": "free",
        "records": _records(rng, 300, 600),
        "environment": True,
        "faults": int(rng.integers(4, 7)),
    }


def imitated(rng: np.random.Generator, seed: int) -> Given:
    """Files with several hidden causes that together have nearly the same effect as fewer other
    causes.
    """
    arm = str(rng.choice(["sino6", "standard-dh", "ur5"]))
    chain = draw_regime(seed, arm=arm).chain()
    places = IMITATED[seed % len(IMITATED)](rng, chain)
    return PLAIN | {
        "arm": arm,
        "evidence": "free",
        "records": _records(rng, 100, 400),
        "places": places,
        "size": _size(rng),
    }


def _waves(rng: np.random.Generator, arm: Chain) -> Places:
    """Two waves of one joint: one error curve."""
    joint = int(rng.integers(1, 4))
    return ("encoder_eccentricity", joint), ("encoder_ellipticity", joint)


def _more_waves(rng: np.random.Generator, arm: Chain) -> Places:
    """Three waves of one joint."""
    joint = int(rng.integers(1, 4))
    return (
        ("encoder_eccentricity", joint),
        ("encoder_ellipticity", joint),
        ("joint_periodic_error", joint),
    )


def _neighbours(rng: np.random.Generator, arm: Chain) -> Places:
    """Compliances of joints that carry the same load, and of a bearing between them."""
    return ("joint_compliance", 2), ("joint_compliance", 3), ("bearing_tilt", 3)


def _tube(rng: np.random.Generator, arm: Chain) -> Places:
    """A tube that bends and the joint that carries it."""
    tube = int(rng.choice(arm.tubes()))
    return ("link_bending", tube), ("joint_compliance", tube)


def _stand(rng: np.random.Generator, arm: Chain) -> Places:
    """A stand, the bearing on it, and the joint above."""
    return ("base_compliance", None), ("bearing_tilt", 1), ("joint_compliance", 2)


IMITATED = (_waves, _more_waves, _neighbours, _tube, _stand)


def payload_sessions(rng: np.random.Generator, seed: int) -> Given:
    """Files with compliant joints, measured torques, and a different payload in each session."""
    return PLAIN | {
        "arm": str(rng.choice(["standard-dh", "modified-dh", "ur5", "panda"])),
        "evidence": str(rng.choice(["free", "target"], p=[0.8, 0.2])),
        "records": _records(rng, 100, 400),
        "environment": True,
        "torque": True,
        "payload_by_session": True,
        "noted": ("payload_kg",) if rng.uniform() < 0.5 else (),
        "cause": "joint_compliance",
        "faults": int(rng.integers(1, 3)),
    }


def nothing(rng: np.random.Generator, seed: int) -> Given:
    """Files without hidden causes, with stated noise."""
    return {"noise_stated": "all", "records": _records(rng, 60, 300), "faults": 0}


FAMILIES: dict[str, Callable[[np.random.Generator, int], Given]] = {
    "regimes": regimes,
    "outside": outside,
    "outside-alone": outside_alone,
    "noise-not-stated": noise_not_stated,
    "held-postures": held_postures,
    "many-causes": many_causes,
    "imitated": imitated,
    "payload-sessions": payload_sessions,
    "nothing": nothing,
}
"""What each family draws from a generator and the seed."""


def _records(rng: np.random.Generator, low: int, high: int) -> int:
    return int(np.exp(rng.uniform(np.log(low), np.log(high + 1))))


def _size(rng: np.random.Generator) -> float:
    """In workshops' sizes."""
    return float(np.exp(rng.uniform(np.log(0.25), 0.0)))
