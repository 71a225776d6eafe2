"""What is drawn: a list of experiments, each a set of arguments of :func:`blind.draw` and the seeds it is run with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from blind import workshop
from blind.outside import DEPENDS_ON
from blind.plant import ENCODER_NOISE, REFERENCE_NOISE

CAUSES = tuple(cause for cause in workshop.CAUSES if cause != "unexplained")
OUTSIDE = tuple(f"unexplained:{kind}" for kind in DEPENDS_ON)


@dataclass(frozen=True)
class Experiment:
    """Runs of one sort.

    Attributes:
        name: by which ``--only`` and the table know it.
        draw: arguments of :func:`blind.draw` (or :func:`blind.regimes.regime_file`) beside the seed.
        first: seed of run 0; run i has ``first + i``.
        causes: the hidden cause of each run, in turn; none: as ``draw`` says.
        share: of the number of runs asked for.
        likely: also ask the oracle for the probability of each cause, about a second a run of 300 records.
        fresh: ``--fresh`` measures the gain on fresh data here.
        regime: a file of :mod:`blind.regimes`.
    """

    name: str
    first: int
    draw: Mapping[str, Any]
    causes: Sequence[str] = ()
    share: float = 1.0
    likely: bool = False
    fresh: bool = False
    regime: bool = False

    def arguments(self, run: int) -> dict[str, Any]:
        """Of :func:`blind.draw` for run number ``run``."""
        cause = {"cause": self.causes[run % len(self.causes)]} if self.causes else {}
        return {"seed": self.first + run, **self.draw, **cause}

    @property
    def options(self) -> list[str]:
        """Of the command line: the noise that the plant has, and where the references come from."""
        words = ["--encoder-noise-rad", f"{ENCODER_NOISE:.12g}", "--reference-noise-mm", f"{1e3 * REFERENCE_NOISE:.12g}"]
        if self.draw.get("plan", "free") != "free":
            words += ["--probe-noise-mm", f"{1e3 * REFERENCE_NOISE:.12g}"]
        if self.draw.get("external"):
            words += ["--reference-frame", "external"]
        return words


SINGLE, SEATS = {"cause": "any"}, {"plan": "seats"}
PAIR = {"cause": "any", "count": 2}
EXPERIMENTS = (
    Experiment("single-free", 10000, SINGLE, likely=True, fresh=True),
    Experiment("single-seats", 11000, SINGLE | SEATS, likely=True, fresh=True),
    Experiment("single-free-half", 12000, SINGLE | {"size": 0.5}, likely=True, fresh=True),
    Experiment("single-seats-half", 13000, SINGLE | SEATS | {"size": 0.5}, likely=True, fresh=True),
    Experiment("nothing-free", 20000, {}),
    Experiment("nothing-seats", 21000, SEATS),
    Experiment("nothing-unknown-seats", 22000, {"plan": "unknown-seats"}),
    Experiment("nothing-outliers", 23000, {"outliers": 0.1}),
    Experiment("nothing-seats-outliers", 24000, SEATS | {"outliers": 0.1}),
    Experiment("twins", 10000, SINGLE | {"twin": True}),
    Experiment("pairs-free", 30000, PAIR),
    Experiment("pairs-seats", 31000, PAIR | SEATS),
    Experiment("outside-free", 40000, {}, OUTSIDE),
    Experiment("outside-seats", 41000, SEATS, OUTSIDE),
    Experiment("outliers-single", 50000, SINGLE | {"outliers": 0.1}),
    Experiment("outliers-single-seats", 51000, SINGLE | SEATS | {"outliers": 0.1}),
    Experiment("external", 54000, SINGLE | {"external": True}),
    Experiment("causes-free", 60000, {}, [c for c in CAUSES if c != "seat_error"], likely=True),
    Experiment("causes-seats", 61000, SEATS, CAUSES, likely=True),
    Experiment("regimes", 100000, {}, share=10.0, regime=True),
)
"""Each has seeds of its own, so that runs may be counted together; only the twins repeat the arms of ``single-free``."""
