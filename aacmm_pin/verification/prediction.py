"""Predict the test values of an acceptance test by virtual runs of its probed points.

Each run draws the errors of the arm's parameters once and the noise of every probed point anew
(JCGM 101:2008, 6.4). The tip is at the point p. The model does not contain the errors e, and
computes p - S e there, to first order in e; the noise η of the readings adds J η. The
characteristics are those of :mod:`aacmm_pin.verification.characteristics`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from aacmm_pin._support.checks import Array, whole
from aacmm_pin._support.display import Shown
from aacmm_pin._support.file_problems import Problems
from aacmm_pin._support.notes import Note, notes_in_json
from aacmm_pin._support.progress import Progress, watched
from aacmm_pin._support.units import MM
from aacmm_pin.accuracy import ErrorSources, source_errors
from aacmm_pin.effects import ErrorModel, GivenModel, of_geometry
from aacmm_pin.errors import AacmmError
from aacmm_pin.measurements import ENCODER, read_probed_points, read_table, seed_of
from aacmm_pin.verification.accept import CharacteristicValue, checked_limits
from aacmm_pin.verification.characteristics import Definition, definitions
from aacmm_pin.verification.procedure import Procedure

PREDICTION_SCHEMA = "aacmm-pin/acceptance-prediction/1"
RUNS, FEWEST = 200, 20
"""Virtual runs: default, and the fewest that determine an interval."""
ALONE = 20
"""The effect of one cause alone is the median of about so many of the runs."""
READINGS, CONTACTS = "encoder noise", "contact noise"
"""Causes beside the parameters."""


@dataclass(frozen=True, eq=False)
class PredictedFigure:
    """The predicted test value of one characteristic of one arm.

    Attributes:
        source: the arm, as it was named.
        definition: the characteristic.
        runs: the test value in each run, with its sign, its standard uncertainty and its limit.
        alone: median magnitude of the test value by each cause alone [m], largest first.
    """

    source: str
    definition: Definition
    runs: tuple[CharacteristicValue, ...]
    alone: pd.Series

    @property
    def magnitudes(self) -> Array:
        """Of the test value in each run (runs,) [m]; nan where probed points are missing."""
        return np.abs([figure.evaluated.value for figure in self.runs])

    @property
    def passes(self) -> float:
        """Share of the runs with the verdict ``conformity``; nan without a limit or a value."""
        verdicts = [figure.verdict for figure in self.runs]
        if None in verdicts:
            return math.nan
        return verdicts.count("conformity") / len(verdicts)

    def row(self) -> dict[str, Any]:
        """The columns of a table of them, lengths in mm; nan or None where there is no number."""
        low, median, high = np.quantile(self.magnitudes, (0.025, 0.5, 0.975)) / MM
        row: dict[str, Any] = {"arm": self.source, "figure": self.definition.name}
        row |= {"median_mm": median, "low_mm": low, "high_mm": high}
        row |= {"mpe_mm": self.runs[0].mpe / MM, "probability_to_pass": self.passes}
        row |= {"dominant": None, "dominant_alone_mm": math.nan}
        if len(self.alone):
            row["dominant"] = str(self.alone.index[0])
            row["dominant_alone_mm"] = self.alone.iloc[0] / MM
        return row | {"missing": self.runs[0].missing}


@dataclass(frozen=True, eq=False)
class PredictedAcceptance(Shown):
    """The predicted test values of an acceptance test.

    Attributes:
        path: file of the procedure.
        figures: predicted test value of each characteristic, grouped by arm.
        count: number of virtual runs.
        seed: seed of the random generator, or None if unknown.
        notes: assumptions, and limits of the prediction.
    """

    path: str
    figures: tuple[PredictedFigure, ...]
    count: int
    seed: int | None
    notes: tuple[Note, ...] = ()

    def to_frame(self) -> pd.DataFrame:
        """Return a table with one row for each characteristic, lengths in mm.

        NaN means that probed points are missing, or that no limit is given.
        """
        return pd.DataFrame([figure.row() for figure in self.figures])

    def causes(self) -> pd.DataFrame:
        """Return the median magnitude of each test value if one cause acts alone, for each cause
        [mm].
        """
        rows = []
        for figure in self.figures:
            alone = (figure.alone / MM).add_suffix("_mm").to_dict()
            rows.append({"arm": figure.source, "figure": figure.definition.name} | alone)
        return pd.DataFrame(rows)

    def __str__(self) -> str:
        judged = [f for f in self.figures if not math.isnan(f.passes)]
        least = min(judged, key=lambda f: f.passes, default=None)
        text = f"{self.count} virtual runs predict {len(self.figures)} characteristics"
        if least is None:
            return text
        return (
            f"{text}; {least.definition.name} of {least.source} conforms least often, in "
            f"{100 * least.passes:.0f} % of the runs"
        )

    def summary(self) -> dict[str, Any]:
        """Return the content of the JSON file with the schema
        ``aacmm-pin/acceptance-prediction/1``.
        """
        table = self.to_frame().astype(object)
        rows = table.where(table.notna(), None).to_dict("records")
        figures = []
        for row, figure in zip(rows, self.figures, strict=True):
            alone = {str(cause): float(value) / MM for cause, value in figure.alone.items()}
            figures.append(row | {"alone_mm": alone})
        summary: dict[str, Any] = {
            "schema": PREDICTION_SCHEMA,
            "procedure": self.path,
            "runs": self.count,
        }
        summary |= {"seed": self.seed, "figures": figures}
        return summary | notes_in_json(self.notes)


def predict_acceptance(
    path: str | Path,
    arms: Mapping[str, GivenModel],
    *,
    mpe: Mapping[str, float] | None = None,
    standard: str | None = None,
    encoder_noise: ArrayLike | None = None,
    probe_noise: float = 0.0,
    runs: int = RUNS,
    rng: np.random.Generator | None = None,
    progress: Progress = True,
) -> PredictedAcceptance:
    """Predict the test values of a procedure, with an interval and the cause of the largest effect.

    The prediction contains only uncertainties that the arm states: half-widths or the covariance of
    a calibration, uncertainties of causes, and noise. Causes that the model lacks have no effect on
    the prediction.

    Args:
        path: file of a procedure from :func:`aacmm_pin.verification.acceptance_procedure`.
        arms: nominal, calibrated or extended arms by their names in the result.
        mpe: maximum permissible errors by the name of the characteristic [m].
        standard: ``iso10360-12`` or ``asme-b89.4.22``; the result then has the characteristics of
            this standard alone.
        encoder_noise: standard uncertainty of one reading, ``(nq,)`` or one number [rad]; default
            from the arm file, else a typical value.
        probe_noise: standard uncertainty of each coordinate of one contact [m].
        runs: number of virtual runs.
        rng: random generator; default seed 1. Every arm has the same draws.
        progress: True for a progress bar in a notebook or on stderr, or a function such as
            ``tqdm``.

    Raises:
        MeasurementFileError: the file is not a procedure for this arm.
        UnknownNameError: a characteristic or a standard is unknown.
        AacmmError: there is no arm, there are fewer than 20 runs, or an arm states no uncertainty.
    """
    path = str(path)
    limits = checked_limits(mpe)
    of_standard = definitions(standard)
    rng = rng or np.random.default_rng(1)
    if left_out := [name for name in limits if name not in {d.name for d in of_standard}]:
        raise AacmmError(
            f"an MPE is stated for {', '.join(left_out)}; expected only characteristics of "
            f"{standard}"
        )
    if not arms:
        raise AacmmError(f"{path}: no arm is stated; state one or more arms before the procedure")
    whole(runs, FEWEST, "runs")
    seed = seed_of(rng)
    draws = int(rng.integers(2**32))
    table, lines, notes, _ = read_table(path)
    problems = Problems(path, lines)
    probed_points = read_probed_points(table, problems)
    problems.stop()
    found: list[PredictedFigure] = []
    for name, arm in arms.items():
        model = ErrorModel.of(arm)
        procedure = Procedure.read(path, model.arm)
        noise = encoder_noise if encoder_noise is not None else model.arm.encoder_noise
        if noise is None:
            noise = ENCODER
            notes += (Note("encoder_noise_assumed", {"noise": ENCODER}).with_place(name),)
        test = _Test.of(model, procedure, noise, probe_noise, max(runs // ALONE, 1))
        notes += tuple(caveat.with_place(name) for caveat in test.sources.caveats)
        missing = test.sources.not_included
        notes += tuple(
            Note("cause_not_predicted", {"cause": cause}).with_place(name) for cause in missing
        )
        wanted = [
            d
            for d in of_standard
            if d.name in limits
            or probed_points.loc[probed_points["test"] == d.test, d.column or "test"].any()
        ]
        with watched(range(runs), progress, name, "run") as steps:
            found += test.figures(
                name, probed_points, wanted, limits, steps, np.random.default_rng(draws)
            )
    return PredictedAcceptance(path, tuple(found), runs, seed, notes)


@dataclass(frozen=True, eq=False)
class _Test:
    """The probed points of a procedure by one arm.

    Attributes:
        sources: what is uncertain.
        causes: what each of the sources belongs to, in words.
        points: where the probe is (n, 3) [m].
        sensitivity: (n, 3, p) [m/unit].
        probe_noise: [m].
        every: in every so many-th run each cause is looked at alone.
    """

    sources: ErrorSources
    causes: tuple[str, ...]
    points: Array
    sensitivity: Array
    probe_noise: float
    every: int

    @staticmethod
    def of(
        model: ErrorModel, procedure: Procedure, noise: ArrayLike, probe_noise: float, every: int
    ) -> _Test:
        """The sources of a model at the postures of a procedure."""
        sources = ErrorSources.of(model, None, noise, procedure.q, None)
        names = [effect.cause for effect in of_geometry(model.arm) for _ in effect.terms]
        names += [effect.label for effect in sources.model.effects for _ in effect.terms]
        names += [READINGS] * model.arm.nq
        causes = tuple(names[column] for column in sources.columns)
        sensitivity = sources.sensitivity(procedure.q)
        return _Test(sources, causes, procedure.points, sensitivity, probe_noise, every)

    def figures(
        self,
        name: str,
        probed_points: pd.DataFrame,
        wanted: list[Definition],
        limits: Mapping[str, float],
        steps: Any,
        rng: np.random.Generator,
    ) -> list[PredictedFigure]:
        """Every test value in each of the runs that ``steps`` counts."""
        of_test = {d.test: (probed_points["test"] == d.test).to_numpy() for d in wanted}
        runs: dict[str, list[CharacteristicValue]] = {d.name: [] for d in wanted}
        alone: dict[str, dict[str, list[float]]] = {d.name: {} for d in wanted}

        def evaluated(errors: Array) -> Iterator[tuple[Definition, CharacteristicValue]]:
            x, y, z = (self.points + errors).T
            placed = probed_points.assign(x=x, y=y, z=z)
            for d in wanted:
                figure = d.evaluate(placed[of_test[d.test]])
                yield d, CharacteristicValue(name, d, figure, limits.get(d.name, math.nan))

        for step in steps:
            parts = self._drawn(rng)
            together = sum(parts.values(), np.zeros_like(self.points))
            for d, figure in evaluated(together):
                runs[d.name].append(figure)
            for cause, part in parts.items() if step % self.every == 0 else ():
                for d, figure in evaluated(part):
                    alone[d.name].setdefault(cause, []).append(abs(figure.evaluated.value))
        found = []
        for d in wanted:
            medians = {cause: np.median(values) for cause, values in alone[d.name].items()}
            largest_first = pd.Series(medians, dtype=float).dropna().sort_values(ascending=False)
            found.append(PredictedFigure(name, d, tuple(runs[d.name]), largest_first))
        return found

    def _drawn(self, rng: np.random.Generator) -> dict[str, Array]:
        """The error of the coordinates of one run by each cause (n, 3) [m]."""
        n = len(self.points)
        errors = np.repeat(-source_errors(self.sources, rng, 1), n, axis=0)
        each = np.array([p.scope == "record" for p in self.sources.parameters])
        errors[:, each] = rng.normal(size=(n, int(each.sum()))) * self.sources.u[each]
        names = np.array(self.causes)
        parts = {}
        for cause in dict.fromkeys(self.causes):
            mine = names == cause
            parts[cause] = np.einsum("nip,np->ni", self.sensitivity[:, :, mine], errors[:, mine])
        if self.probe_noise > 0:
            parts[CONTACTS] = self.probe_noise * rng.normal(size=(n, 3))
        return parts
