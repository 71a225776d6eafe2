"""What is drawn: a list of experiments, each a set of arguments of :func:`blind.draw` and the seeds it is run with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from blind import workshop
from blind.outside import DEPENDS_ON
from blind.plant import ENCODER_NOISE, REFERENCE_NOISE

SEATS_ONLY = ("seat_error",)
CAUSES = tuple(cause for cause in workshop.CAUSES if cause != "unexplained")
OUTSIDE = tuple(f"unexplained:{kind}" for kind in DEPENDS_ON)
WEAK = tuple(0.04 * 1.08**k for k in range(30))
"""Sizes between 0.04 and 0.37, where the power rises."""


@dataclass(frozen=True)
class Experiment:
    """Runs of one sort.

    Attributes:
        name: by which ``--only`` and the table know it.
        kind: ``single``, ``pair``, ``nothing`` or ``outside``: what a right answer is; ``regime``: a file of
            :mod:`blind.regimes`, which is judged by :mod:`blind.study.regimes`.
        draw: arguments of :func:`blind.draw` (or :func:`blind.regimes.regime_file`) beside the seed.
        first: seed of run 0; run i has ``first + i``.
        vary: argument that goes through ``values`` from run to run.
        share: of the number of runs asked for; less than 1 where a run takes long, more where there is much to draw.
        quick: number of runs of ``--quick``.
        likely: also ask the oracle for the probability of each cause, about a second a run of 300 records.
        fresh: ``--fresh`` measures the gain on fresh data here.
    """

    name: str
    kind: str
    draw: Mapping[str, Any]
    first: int
    vary: str | None = None
    values: Sequence[Any] = ()
    share: float = 1.0
    quick: int = 0
    likely: bool = False
    fresh: bool = False

    def arguments(self, run: int) -> dict[str, Any]:
        """Of :func:`blind.draw` for run number ``run``."""
        varied = {} if self.vary is None else {self.vary: self.values[run % len(self.values)]}
        return {"seed": self.first + run, **self.draw, **varied}

    @property
    def options(self) -> list[str]:
        """Of the command line: the noise that the plant has, and where the references come from."""
        words = ["--encoder-noise-rad", f"{ENCODER_NOISE:.12g}", "--reference-noise-mm", f"{1e3 * REFERENCE_NOISE:.12g}"]
        if self.draw.get("plan", "free") != "free":
            words += ["--probe-noise-mm", f"{1e3 * REFERENCE_NOISE:.12g}"]
        if self.draw.get("external"):
            words += ["--reference-frame", "external"]
        return words


def _single(name: str, first: int, quick: int = 0, fresh: bool = False, likely: bool = True, **draw: Any) -> Experiment:
    return Experiment(name, "single", {"cause": "any", **draw}, first, quick=quick, fresh=fresh, likely=likely)


def _nothing(name: str, first: int, quick: int = 0, **draw: Any) -> Experiment:
    return Experiment(name, "nothing", draw, first, quick=quick)


EXPERIMENTS = (
    _single("single-free", 10000, quick=10, fresh=True),
    _single("single-seats", 11000, quick=10, fresh=True, plan="seats"),
    _single("single-free-half", 12000, quick=5, fresh=True, size=0.5),
    _single("single-seats-half", 13000, quick=5, fresh=True, plan="seats", size=0.5),
    _single("single-free-0.3", 14000, size=0.3),
    _single("single-seats-0.3", 15000, plan="seats", size=0.3),
    _single("single-unknown-seats", 16000, plan="unknown-seats"),
    Experiment("weak-free", "single", {"cause": "any"}, 17000, "size", WEAK, likely=True),
    Experiment("weak-seats", "single", {"cause": "any", "plan": "seats"}, 18000, "size", WEAK, likely=True),
    _nothing("nothing-free", 20000, quick=5),
    _nothing("nothing-seats", 21000, quick=5, plan="seats"),
    _nothing("nothing-unknown-seats", 22000, plan="unknown-seats"),
    _nothing("nothing-outliers", 23000, quick=3, outliers=0.1),
    _nothing("nothing-seats-outliers", 24000, outliers=0.1, plan="seats"),
    _nothing("twins", 10000, quick=5, cause="any", twin=True),
    _nothing("twins-seats", 11000, cause="any", twin=True, plan="seats"),
    Experiment("pairs-free", "pair", {"cause": "any", "count": 2}, 30000, quick=5),
    Experiment("pairs-seats", "pair", {"cause": "any", "count": 2, "plan": "seats"}, 31000, quick=5),
    Experiment("outside-free", "outside", {}, 40000, "cause", OUTSIDE, quick=5),
    Experiment("outside-seats", "outside", {"plan": "seats"}, 41000, "cause", OUTSIDE, quick=5),
    _single("outliers-single", 50000, quick=3, likely=False, outliers=0.1),
    _single("outliers-single-seats", 51000, likely=False, outliers=0.1, plan="seats"),
    _single("records-100", 52000, records=100),
    Experiment("records-3000", "single", {"cause": "any", "records": 3000}, 53000, share=0.2),
    _single("external", 54000, likely=False, external=True),
    Experiment("geometry", "single", {"shifts": {(4, "theta_offset"): 9.0}}, 55000, quick=2),
    Experiment(
        "causes-free", "single", {}, 60000, "cause", [c for c in CAUSES if c not in SEATS_ONLY], likely=True, quick=23
    ),
    Experiment("causes-seats", "single", {"plan": "seats"}, 61000, "cause", CAUSES, likely=True),
    Experiment("regimes", "regime", {}, 100000, share=10.0, quick=10),
)
"""Each has seeds of its own, so that runs may be counted together; only the twins repeat the arms of ``single``."""
