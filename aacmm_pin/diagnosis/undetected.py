"""What may act beside the causes that were found: how probable it is, and what it would do to their values."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from aacmm_pin._support.checks import Array
from aacmm_pin._support.display import Shown
from aacmm_pin.diagnosis.forward_backward_selection import shares
from aacmm_pin.diagnosis.model_extension import Choice
from aacmm_pin.effects import Effect

ALONE = 2.0
"""Values whose u is more than so many times as large beside another cause of usual size are told to rest on its absence."""
PROBABLE = 0.1
"""A cause less probable than this beside what was found is not named."""
MOST = 3
"""So many are named at most."""


@dataclass(frozen=True)
class Other(Shown):
    """What may act beside the causes that were found.

    Attributes:
        label: the cause and its place, or the covariate.
        probability: that it is this which acts.
        change: by how many standard uncertainties it would change the values of ``changed``, a cause that was found.
        changed: label of the cause whose values would change most; "" where none was found.
    """

    label: str
    probability: float
    change: float
    changed: str


@dataclass(frozen=True)
class Others(Shown):
    """Whether anything acts beside the causes that were found.

    Attributes:
        probability: that something does, among all candidates and none.
        likeliest: what it may be, the most probable first.
    """

    probability: float
    likeliest: tuple[Other, ...]


def others_beside(choice: Choice, named: Collection[str]) -> Others:
    """What may act beside all that was admitted and the geometry that is ``named``."""
    question, names = choice.question, choice.design.names
    struck_out = question.struck_out(choice.admitted).union(k for k, name in enumerate(names) if name in named)
    odds, best = question.ranked(choice.left.evidences, struck_out)
    probable = shares(odds)
    found = []
    for k in np.argsort(-probable)[:MOST]:
        if probable[k] >= PROBABLE:
            changes = [(_change(choice, own, best[int(k)]), choice.variant(own).label) for own in choice.causes]
            found.append(Other(names[k], float(probable[k]), *max(changes, default=(0.0, ""))))
    return Others(float(probable.sum()), tuple(found))


def _change(choice: Choice, block: int, other: int) -> float:
    """By how many u another block would change the values of an admitted one."""
    left = choice.left
    along, cover = _beside(choice, block, other)
    step = along @ cover @ left.gradient[choice.question.blocks[other].columns]
    return float(np.max(np.abs(step) / np.sqrt(np.diag(left.covariance)[left.projection.places[block]])))


def known_alone(choice: Choice) -> Iterator[tuple[Effect, Effect, float]]:
    """Causes of a joint whose values are known by far better than if another of usual size acted at it too, that other, and
    by how much: the largest ratio of u (JCGM 101:2008, with the other as one more input). Curves, which can be anything, are
    not asked.
    """
    question = choice.question
    asked = {*range(choice.design.causes)} - question.struck_out(choice.admitted) - {*question.contained}
    for k, other in product(choice.causes, sorted(asked)):
        one, beside = choice.variant(k), choice.library[other][0]
        if one.site() != "joint" or beside.place != one.place:
            continue
        ratio = max(_ratio(choice, k, int(block)) for block in np.flatnonzero(question.owners == other))
        if ratio > ALONE:
            yield one, beside, ratio


def _ratio(choice: Choice, block: int, other: int) -> float:
    """Largest ratio of u of the values of an admitted block, with another block of usual size beside it and without."""
    left, (along, cover) = choice.left, _beside(choice, block, other)
    own = left.projection.places[block]
    more = scipy.linalg.eigh(along @ cover @ along.T, left.covariance[own, own], eigvals_only=True)
    return float(np.sqrt(1.0 + more.max()))


def _beside(choice: Choice, block: int, other: int) -> tuple[Array, Array]:
    """By how much the values of an admitted block give way per unit of another (q, q'), and the covariance of the other, if
    it is of usual size (q', q').
    """
    left, beside = choice.left, choice.question.blocks[other]
    along = left.projection.along(beside.columns)[left.projection.places[block]]
    return along, np.asarray(np.linalg.inv(left.information(beside) + np.eye(beside.size)))
