"""Names of files are text in every picture, whatever they hold."""

from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.text import Text

from aacmm_pin import calibrate, circle_accuracy, configuration_circle, simulate_measurements
from aacmm_pin.report import plots, without_latex
from aacmm_pin.report.document import blank_axes

POINT = np.array([33.6323, -671.8702, 182.9355]) * 1e-3


def test_names_are_drawn_as_they_are(sino6, tmp_path, monkeypatch):
    """Text between dollars is a formula to matplotlib, and no drawing of this one; powers of ten
    are, without LaTeX.
    """
    monkeypatch.setitem(mpl.rcParams, "text.usetex", True)
    name = r"$\frac{1$ $x^2$"
    arm = replace(sino6, name=name + "\x1b", file=sino6.file.model_copy(update={"name": name}))
    data = simulate_measurements(arm, "seats", 40, seats=2, rng=np.random.default_rng(1))
    seats = np.array([rf"$\bad{{{seat}$" for seat in data.conditions.seat], dtype=object)
    data = replace(data, conditions=replace(data.conditions, seat=seats), source=name)
    found = calibrate(arm, data, rng=np.random.default_rng(1), hold_out=False)
    circle = configuration_circle(arm, POINT, count=12)
    accuracy = circle_accuracy(circle)
    drawn = [
        plots.plot_residuals_by_seat(found, blank_axes(6, 3)),
        plots.plot_residual_views(found, blank_axes(6, 6)),
        plots.plot_circle(circle, accuracy, ax=Figure().add_subplot(projection="3d")),
        plots.plot_budget(accuracy, ax=blank_axes(6, 3)),
    ]
    for picture in drawn:
        figure = picture if isinstance(picture, Figure) else picture.figure
        with without_latex():  # which is not there; the user's would draw the numbers
            figure.savefig(tmp_path / "a.png")
        assert "\x1b" not in "".join(text.get_text() for text in figure.findobj(Text))
        assert not any(text.get_usetex() for text in figure.findobj(Text))
    assert any(r"$\bad" in label.get_text() for label in drawn[0].get_xticklabels())
