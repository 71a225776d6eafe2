"""Checks over time: limits by hand, what is appended, damaged files, and the test report on one
sheet of paper.
"""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import pytest

from aacmm_pin import Arm, accept
from aacmm_pin._support.output_files import OutputFiles
from aacmm_pin.errors import AacmmError, MeasurementFileError
from aacmm_pin.report.acceptance_page import CheckDetails, acceptance_document
from aacmm_pin.report.formats.html import page as page_of
from aacmm_pin.verification import AcceptanceResult, History
from tests.again import again
from tests.cli import shell
from tests.tables import THETAS
from tests.verification.probed_points import everything, rows

START = datetime(2026, 1, 1, tzinfo=UTC)


def touches(path: Path, size: float) -> Path:
    """One point in ten articulations at three distances; the largest distance from the mean is
    ``size`` [mm].
    """
    offsets = np.zeros((10, 3))
    offsets[:2, 2] = size, -size
    pd.concat([rows(offsets + 100 * k, test="single-point", position=k) for k in range(3)]).to_csv(
        path, index=False
    )
    return path


@cache
def checked(size: float) -> AcceptanceResult:
    with TemporaryDirectory() as folder:
        return accept(touches(Path(folder) / "t.csv", size))


def history(sizes: list[float]) -> History:
    found = History()
    for month, size in enumerate(sizes):
        found = found.with_check(checked(size), START + timedelta(days=30 * month))
    return found


SIZES = [0.020, 0.022, 0.019, 0.021, 0.024, 0.018, 0.023, 0.017]


def saved(path: Path) -> None:
    with OutputFiles() as files:
        history(SIZES).write(files, path)


@pytest.mark.parametrize(("latest", "left"), [(0.0307, False), (0.0308, True), again(0.0102, True)])
def test_limits_are_those_of_individuals_charts(tmp_path, latest, left):
    """Moving ranges 2, 3, 2, 3, 6, 5, 6 µm: their mean 27/7 µm, the mean of the values 20.5 µm."""
    found = history([*SIZES, latest])
    chart = next(chart for chart in found.charts() if chart.figure == "SPAT.Max")
    assert (chart.centre, *chart.limits) == pytest.approx(
        (20.5e-6, *(20.5e-6 + s * 2.66 * 27e-6 / 7 for s in (-1, 1)))
    )
    assert (chart.is_outside, "SPAT.Max" in str(found)) == (left, left)
    wild = history([0.001, 0.02, 0.002, 0.021, 0.003, 0.022, 0.004, 0.023, 0.05]).charts()[0]
    assert (np.isnan(wild.limits[0]), wild.limits[1], wild.is_outside) == (
        True,
        pytest.approx(61.4e-6),
        False,
    )
    few = next(chart for chart in history([*SIZES[1:], 1.0]).charts() if chart.figure == "SPAT.Max")
    assert np.isnan(few.limits).all()
    assert not few.is_outside


def test_a_failed_check_does_not_widen_the_limits(tmp_path):
    """In one month the arm is 2.5 times worse, by its MPE or not; later ones are judged as if that
    were not there.
    """
    usual = history([*SIZES, 0.0201, 0.0231])
    (expected,) = (chart.limits for chart in usual.charts() if chart.figure == "SPAT.Max")
    for mpe in ({}, {"SPAT.Max": 4e-5}):
        found = history([*SIZES, 0.0201])
        for month, size in ((10, 0.05), (11, 0.0231)):
            result = accept(touches(tmp_path / "t.csv", size), mpe=mpe)
            found = found.with_check(result, START + timedelta(days=30 * month))
        (chart,) = (chart for chart in found.charts() if chart.figure == "SPAT.Max")
        assert (chart.limits, chart.counted.tolist()) == (expected, [True] * 9 + [False])
        assert {row["figure"]: row["checks_counted"] for row in found.summary()} == {
            "SPAT.Max": 9,
            "SPAT.2s": 9,
        }


def test_a_check_is_appended_once(tmp_path):
    path, data = tmp_path / "checks.csv", touches(tmp_path / "t.csv", 0.02)
    words = f"accept {data} --history {path} --mpe SPAT.Max=0.03 --instrument"
    for _ in range(2):
        out, err = shell.done(f"{words} 'no. 12' --time 2026-01-31T10:00+01:00 --json -")
        assert len(pd.read_csv(path)) == 3
    assert "appended no check" in err
    table = pd.read_csv(path)
    assert set(table["time"]) == {"2026-01-31T09:00:00+00:00"}
    first = table.iloc[0].dropna().to_dict()
    wanted = ("SPAT.Max", "conformity", "no. 12")
    assert (first["figure"], first["verdict"], first["instrument"]) == wanted
    assert {row["checks_before"] for row in json.loads(out)["history"]} == {0}
    _, err = shell.done(f"{words} ' NO. 12' --time 2026-02-28")
    assert (len(pd.read_csv(path)), "2026-01-31 09:00" in err) == (3, True)
    touches(data, 0.03)
    shell.refused(f"{words} 'no. 12' --time 2026-01-31T09:00")
    assert len(pd.read_csv(path)) == 3
    shell.done(f"{words} 'no. 12' --time 2026-02-28")
    assert pd.read_csv(path)["value_mm"].tolist()[::3] == pytest.approx([0.02, 0.03])


def test_an_instrument_is_one_however_it_is_written(tmp_path):
    path = tmp_path / "checks.csv"
    saved(path)
    table = pd.read_csv(path)
    table.assign(instrument=(["Arm7", "ARM7", "Arm7 "] * len(table))[: len(table)]).to_csv(
        path, index=False
    )
    found = History.read(path).with_check(
        accept(touches(tmp_path / "t.csv", 0.05)), START + timedelta(days=999), "arm7"
    )
    assert {(len(chart.values), chart.is_outside) for chart in found.charts()} == {
        (len(SIZES) + 1, True)
    }


def test_a_verdict_that_comes_later_is_kept(tmp_path):
    path = touches(tmp_path / "t.csv", 0.02)
    first = History().with_check(accept(path), START)
    later = first.with_check(accept(path, mpe={"SPAT.Max": 1e-5}), START + timedelta(days=1))
    assert (len(later.checks), later.appended, set(later.checks["time"])) == (3, True, {START})
    assert set(later.checks["verdict"]) == {"", "non-conformity"}
    again = later.with_check(accept(path, mpe={"SPAT.Max": 1.0}), START + timedelta(days=2))
    assert not again.appended  # a verdict that is there stays
    with pytest.raises(AacmmError, match="instrument"):
        first.with_check(accept(path), START, "a\n#b")


def test_further_figures_of_a_check_join_it(tmp_path):
    result = accept(touches(tmp_path / "t.csv", 0.02))
    of_part = History().with_check(accept(tmp_path / "t.csv", standard="asme-b89.4.22"), START)
    assert 0 < len(of_part.checks) < len(result.figures)
    found = of_part.with_check(result, START)
    assert sorted(found.checks["figure"]) == sorted(f.definition.name for f in result.figures)


@pytest.mark.parametrize(
    ("column", "cell"),
    [
        ("value_mm", "0,02"),
        ("time", "31.1.2026"),
        again("value_mm", ""),
    ],
)
def test_damaged_histories_are_refused(tmp_path, column, cell):
    path, data = tmp_path / "checks.csv", touches(tmp_path / "t.csv", 0.02)
    saved(path)
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    table.loc[4, column] = cell
    table.to_csv(path, index=False)
    before = path.read_bytes()
    shell.refused(f"accept {data} --history {path}")
    assert path.read_bytes() == before
    with pytest.raises(MeasurementFileError) as raised:
        History.read(path)
    assert (raised.value.row, raised.value.column) == (6, column)
    path.write_bytes(b"# serviced\n" + before)  # which would be lost
    with pytest.raises(MeasurementFileError, match="without comments"):
        History.read(path)
    path.write_bytes(before[: len(before) // 2])
    with pytest.raises(AacmmError, match="row"):
        History.read(path)


def test_times_are_of_one_zone(tmp_path):
    saved(path := tmp_path / "checks.csv")
    times = pd.read_csv(path)["time"]
    path.write_text(
        path.read_text().replace("2026-01-31T00:00:00+00:00", "2026-01-31T02:00:00+02:00")
    )
    assert History.read(path).checks["time"].tolist() == pd.to_datetime(times, utc=True).tolist()


def test_a_test_report_is_one_sheet(tmp_path, page):
    """With all figures of three sets of coordinates, and charts; on a phone it is as wide
    as that.
    """
    table = everything()
    table["part"] = np.where(
        table["test"] == "single-point", np.where(np.arange(len(table)) % 2, "high", ""), ""
    )
    arm = Arm.load("sino6")
    # Within the limits.
    angles = np.random.default_rng(1).uniform(0, 20, (len(table), 6)) * (1, -1, 1, -1, 1, 1)
    table[THETAS] = angles
    table.assign(temperature_c=20.1).to_csv(tmp_path / "touches.csv", index=False)
    mpe = {"E_Uni": 1e-4, "E_Bi": 1e-4, "SPAT.Max": 1e-4}
    arms = {"nominal": arm, "extended": arm}
    result = accept(tmp_path / "touches.csv", arms, mpe=mpe)
    table.assign(z_mm=table["z_mm"] * 1.0001).to_csv(tmp_path / "before.csv", index=False)
    before = accept(tmp_path / "before.csv", {"nominal": arm})
    checks = history(SIZES).with_check(before, START + timedelta(days=270))
    checks = checks.with_check(result, START + timedelta(days=300))
    told = CheckDetails(START, "no. 12", {"humidity": "45 %"}, checks)
    target = tmp_path / "report.html"
    target.write_text(page_of(acceptance_document(result, told)), encoding="utf-8")
    page.open(target, (390, 800), touch=True)
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 390
    assert page.evaluate("document.querySelectorAll('figure img').length") == 1
    seen = page.evaluate("document.body.textContent")
    assert all(text in seen for text in ("Operator", "Signature", "value [mm]", str(result)))
    assert page.printed_pages() == 1
    assert page.errors == []
