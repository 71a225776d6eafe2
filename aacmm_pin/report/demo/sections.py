"""What the page says about the arm: its postures and accuracy at a point and over the workspace."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from aacmm_pin._support.checks import Array
from aacmm_pin._support.units import DEG, MM, MM3, UM
from aacmm_pin.accuracy.comprehensive import configuration_weights
from aacmm_pin.accuracy.volume import COVERAGE_FACTOR, Method
from aacmm_pin.postures.reach import reach_of_wrist
from aacmm_pin.report import plots
from aacmm_pin.report.demo.picture import new_axes, picture
from aacmm_pin.report.demo.study import DRAWS, SEED, Study
from aacmm_pin.report.html import Bullets, Paragraph, Part, Picture, SceneView, Table
from aacmm_pin.report.scenes import circle_scene, map_scene

URAD = 1e-6
"""One microradian [rad]."""


def about_arm(study: Study) -> list[Part]:
    """Dimensions, half-widths, limits."""
    arm, dh = study.arm, study.arm.require_dh("the demo")
    longest = np.sort(np.abs(np.concatenate([dh.a, dh.d])))[::-1] / MM
    return [
        f"{arm.name} is a passive measuring arm with {arm.nq} joints. Its longest pieces measure {longest[0]:.0f} mm and "
        f"{longest[1]:.0f} mm. The table holds its {dh.convention} values; every value marked ± is taken to lie within that "
        "half-width according to the calibration, and these half-widths are the only causes of error in the predictions of "
        "sections 3 to 5.",
        Table(
            _dh_table(study),
            f"Denavit–Hartenberg values of {arm.name} with the half-widths of their calibration: mm for lengths, µrad for "
            "angles",
        ),
        f"The working point is the wrist, the origin of {study.circle.at}: what lies behind it does not matter for the "
        "position, so the probe and the stylus have no part in any number below.",
    ]


def _dh_table(study: Study) -> pd.DataFrame:
    dh = study.arm.require_dh("the demo")
    half = np.array([p.half_width or 0.0 for p in study.arm.parameters]).reshape(dh.rows, 4)
    columns: dict[str, list[str]] = {"row": [str(i + 1) for i in range(dh.rows)]}
    heads = (("a [mm]", MM), ("d [mm]", MM), ("α [rad]", 1.0), ("θ offset [rad]", 1.0))
    for k, (head, unit) in enumerate(heads):
        values, widths = dh.values()[:, k] / unit, half[:, k]
        columns[head] = [f"{v:.5f}{_half_width(w, unit)}" for v, w in zip(values, widths, strict=True)]
    limits = iter(study.arm.limits / DEG)
    columns["limits [deg]"] = [_limits(next(limits)) if moving else "rigid" for moving in dh.moving]
    return pd.DataFrame(columns)


def _half_width(width: float, unit: float) -> str:
    """``width`` [m or rad] as it stands behind a value: in mm as the value, or in µrad."""
    if not width:
        return ""
    return f" ± {width / MM:.5f}" if unit == MM else f" ± {_significant(width / URAD)} µrad"


def _significant(value: float) -> str:
    """Three significant digits, never as a power of ten."""
    return f"{value:.{max(0, 2 - int(np.floor(np.log10(abs(value)))))}f}"


def _limits(pair: Array) -> str:
    return f"{pair[0]:.0f} to {pair[1]:.0f}"


def about_postures(study: Study, out: Path) -> list[Part]:
    """Components, limits, flexibility at the working point."""
    circle = study.circle
    x, y, z = circle.point / MM
    zeta = circle.flexibility(study.sectors)
    within = int(circle.within_limits.sum())
    caption = (
        f"{circle.arm.name} in five of the postures that reach the point, light to dark along the circle, each drawn to the "
        "wrist. The closed line is the path of the elbow: coloured by the accuracy volume where all joints are within "
        "limits, grey where not. Grey paths of other components may lie close beside or below the coloured one."
    )
    return [
        f"With the wrist held at ({x:.4f}, {y:.4f}, {z:.4f}) mm the arm can still move: the elbow runs along closed curves. "
        f"There are {len(circle.components.curves)} of them, sampled at {len(circle)} configurations.",
        Paragraph(
            f"{within} of {len(circle)} configurations respect the joint limits. Flexibility ζ = {zeta.zeta:.3f}, judged at "
            f"the centres of {study.sectors} sectors of the swivel angle; by arc, {100 * zeta.arc_fraction:.1f} % of the "
            "circle can be used.",
            finding=True,
        ),
        Table(
            circle.summary().rename(columns=lambda name: name.replace("_", " ")),
            "Closed components. Shoulder side: of the plane of joint axes 1 and 2; elbow side: +1 where a growing θ4 "
            "stretches the arm.",
        ),
        picture(
            plots.plot_circle(circle, study.accuracy, ax=new_axes(7.2, 6.6, "3d")),
            out,
            "circle",
            f"The elbow's path round the working point and {circle.arm.name} in five postures",
            caption,
        ),
        SceneView(
            circle_scene(circle, study.accuracy),
            "The same to turn and to move: drag to look from elsewhere; the slider takes the arm round the circle. At the "
            "wrist stands the 95 % coverage ellipsoid of the posture, magnified.",
        ),
    ]


def about_accuracy(study: Study, summary: dict[str, Any], out: Path) -> list[Part]:
    """Volume, uncertainty, methods and budget at the working point."""
    accuracy, circle = study.accuracy, study.circle
    volume, u = summary["volume_mm3"], accuracy.u / UM
    ratio = volume["max"] / volume["min"]
    budget = accuracy.budget()
    first = budget.head(2)
    return [
        "The accuracy volume is the volume of all positions that the wrist may take while every parameter lies anywhere "
        "within its half-width; to first order this set is a zonotope, and its volume is exact. The standard uncertainty u "
        "is the root of the summed variances of the three coordinates, with rectangular distributions.",
        Paragraph(
            f"The accuracy volume runs from {volume['min']:.5f} mm³ to {volume['max']:.5f} mm³ with the posture, a factor "
            f"of {ratio:.2f}, as if lengths grew by {100 * (ratio ** (1 / 3) - 1):.0f} %. The standard uncertainty runs "
            f"from {u.min():.1f} µm to {u.max():.1f} µm, {100 * (u.max() / u.min() - 1):.1f} %.",
            finding=True,
        ),
        *_disagreement(study),
        Table(
            _posture_table(study),
            "Six postures (angles in degrees; θ1, θ2, … are the angles of the joints)",
            {"volume [mm³]": ".5f", "u [µm]": ".1f", "largest deviation [µm]": ".0f", "swivel": ".1f"}
            | {f"θ{j + 1}": ".2f" for j in range(study.arm.nq)},
        ),
        _expansion_text(study),
        picture(
            plots.plot_accuracy_over_swivel(circle, accuracy, new_axes(7.5, 4.2)),
            out,
            "accuracy_over_swivel",
            "Accuracy volume and standard uncertainty over the swivel angle",
            "Accuracy over the swivel angle of the elbow. Neither scale starts at zero.",
        ),
        picture(
            plots.plot_accuracy_over_theta3(circle, accuracy, new_axes(6.0, 5.0)),
            out,
            "accuracy_over_theta3",
            "Accuracy volume round the circle of joint angle 3",
            "The same volumes over θ3, drawn as the source paper draws them.",
        ),
        f"Comprehensive accuracy (eq. 15 of the paper): {volume['comprehensive']:.5f} mm³; the median is "
        f"{volume['median']:.5f} mm³. {_weights_text(study)}",
        _methods_table(study),
        _methods_text(study),
        f"Where it comes from: {first['parameter'][0]} makes {100 * first['share'][0]:.0f} % of the variance and "
        f"{first['parameter'][1]} another {100 * first['share'][1]:.0f} %, averaged over the postures within limits. "
        "Here theta_offset3 is the zero offset of joint 3 (of encoder 3), the same in every posture; θ3 elsewhere on this "
        f"page is the angle of that joint. {_without_part(study, budget)}",
        _budget_picture(study, "parameter", 4.7, out),
        _budget_picture(study, "joint", 2.5, out),
    ]


def _budget_picture(study: Study, by: Literal["parameter", "joint"], height: float, out: Path) -> Picture:
    return picture(
        plots.plot_budget(study.accuracy, by, new_axes(7.0, height)),
        out,
        f"budget_by_{by}",
        f"Bars of the shares of the variance by {by}",
        f"Uncertainty budget by {by}: share of the variance, and the standard uncertainty that it alone would cause.",
    )


def _disagreement(study: Study) -> list[Part]:
    """A paragraph where volume and u rank the postures differently."""
    accuracy, ends = study.accuracy, [study.best, study.worst]
    low, high = accuracy.u[ends] / UM
    if low <= high:
        return []
    axes = _principal_u(study, ends)
    return [
        f"The two measures do not rank the postures alike: where the volume is smallest u is {low:.1f} µm, where it is "
        f"largest {high:.1f} µm. The volume is like a product of three half-axes and follows the thinnest; u follows the "
        f"longest. The standard uncertainties along the three principal axes are {_listed(axes[0])} µm in the first posture "
        f"and {_listed(axes[1])} µm in the second. For distances u says more than the volume."
    ]


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.0f}" for value in values)


def _posture_table(study: Study) -> pd.DataFrame:
    accuracy = study.accuracy
    picks = {
        "smallest volume": study.best,
        "largest volume": study.worst,
        "smallest u": int(np.argmin(accuracy.u)),
        "largest u": int(np.argmax(accuracy.u)),
        "elbow highest": int(np.argmin(np.abs(study.inside))),
        "elbow lowest": int(np.argmax(np.abs(study.inside))),
    }
    rows = list(picks.values())
    table = pd.DataFrame(
        {
            "posture": list(picks),
            "volume [mm³]": accuracy.volume[rows] / MM3,
            "u [µm]": accuracy.u[rows] / UM,
            "largest deviation [µm]": accuracy.largest_deviation[rows] / UM,
            "swivel": study.inside[rows] / DEG,
        }
    )
    for j in range(study.arm.nq):
        table[f"θ{j + 1}"] = accuracy.q[rows, j] / DEG
    return table


def _expansion_text(study: Study) -> Part:
    """How far the wrist may be off: the bound, and what a coverage factor means here."""
    accuracy = study.accuracy
    least = int(np.argmin(accuracy.u))
    axes = _principal_u(study, [least])[0]
    deviation = accuracy.largest_deviation / UM
    return (
        f"The largest deviation, {deviation.min():.0f} µm to {deviation.max():.0f} µm over all postures within limits, is "
        "the farthest that all half-widths together can take the wrist: a bound, to first order. An expanded uncertainty is "
        f"U = k u. In three dimensions k = {COVERAGE_FACTOR:.2f} belongs to the 95 % ellipsoid of a normal distribution and "
        f"applies along its axes: in the posture with the smallest u they are {_listed(axes)} µm (standard) and "
        f"{_listed(COVERAGE_FACTOR * axes)} µm (expanded). {COVERAGE_FACTOR:.2f} times u itself is not the radius of a 95 % "
        "sphere, but more than it needs; and with few rectangular errors that dominate, 95 % is itself approximate."
    )


def _principal_u(study: Study, rows: list[int]) -> Array:
    """Standard uncertainties along the principal axes (n, 3) [µm], smallest first."""
    return np.asarray(np.sqrt(np.linalg.eigvalsh(study.accuracy.covariance[rows])) / UM)


def _weights_text(study: Study) -> str:
    q = study.accuracy.q
    few = q[:: max(1, len(q) // study.sectors)]
    ratios = [float(w.max() / w.min()) for w in (configuration_weights(c[:, 2], study.circle.point) for c in (q, few))]
    return (
        "It is a weighted mean of the volumes, heavier where θ3 is near the angle that the paper finds handiest; the "
        f"weights differ by a factor of {ratios[0]:.3f} at most over these {len(q)} postures and of {ratios[1]:.2f} over "
        f"{len(few)} of them, about as many as a cell of the map has, so it is close to the plain mean."
    )


def _methods_table(study: Study) -> Table:
    meaning: dict[Method, str] = {
        "zonotope": "all that the half-widths allow together, first order",
        "jointwise": "eq. 14: each row's own zonotope, added up",
        "ellipsoid": "95 % coverage ellipsoid of the covariance",
        "monte-carlo": f"the real model: volume of the hull of {DRAWS} positions at corners of the box of half-widths; u "
        f"from {DRAWS} other, random draws inside the box; seed {SEED}",
    }
    rows = [
        (name, *(study.methods[name].volume / MM3), *(study.methods[name].u / UM), text) for name, text in meaning.items()
    ]
    heads = ["method", "smallest [mm³]", "largest [mm³]", "u there [µm]", "and there [µm]", "what it is"]
    formats = dict(zip(heads[1:5], (".3g", ".3g", ".1f", ".1f"), strict=True))
    caption = "Volume and standard uncertainty by four methods, in the postures with the smallest and the largest zonotope"
    return Table(pd.DataFrame(rows, columns=heads), caption, formats)


def _methods_text(study: Study) -> Part:
    smaller = study.methods["zonotope"].volume / study.methods["jointwise"].volume
    return (
        "Monte Carlo moves the real model; its positions are exact. Its volume is that of the hull of those corners of the "
        "box that first order says go farthest, and so lies inside the true set; against the zonotope it comes out "
        f"{study.monte_carlo_text}. Its covariance comes from separate random draws, has their scatter and gives the same "
        "u: first order is enough. Equation 14, "
        f"read as a sum over rows, is smaller by factors of {smaller.min():.0f} and {smaller.max():.0f}: it leaves out all "
        "volume that errors of different rows span together. It should not be read as the region where the wrist may be."
    )


def _without_part(study: Study, budget: pd.DataFrame) -> str:
    stated = {p.name for p in study.accuracy.sources.parameters}
    none = [name for name in budget.loc[budget["share"] < 1e-12, "parameter"] if name in stated]
    return f"Without any effect on the wrist: {', '.join(none)}." if none else ""


def about_map(study: Study, out: Path) -> list[Part]:
    """Flexibility and comprehensive accuracy over the half-plane."""
    map_, data = study.map, study.map.data
    counts = map_.working_sectors()
    reachable = sum(counts.values())
    values = data["comprehensive_mm3"].values
    (low, low_at), (high, high_at) = (_extreme(data, "comprehensive_mm3", pick) for pick in (np.nanargmin, np.nanargmax))
    (least, least_at), (most, most_at) = (_extreme(data, "smallest_u_mm", pick) for pick in (np.nanargmin, np.nanargmax))
    table = pd.DataFrame({"working sectors": list(counts), "cells": list(counts.values())}).query("cells > 0")
    return [
        f"The arm turns about joint axis 1, so one half-plane stands for all of space. It is divided into {values.shape[0]} "
        f"× {values.shape[1]} cells; at the centre of each the circle is judged at {map_.sectors} swivel angles. "
        f"{map_.unreachable} centres are out of reach, {reachable} can be reached. {_box_text(study)}",
        Paragraph(
            f"{counts[map_.sectors]} of the {reachable} reachable cells have the full circle, mean flexibility "
            f"{float(data['flexibility'].mean()):.3f}. The comprehensive accuracy runs from {low:.5f} mm³ at {low_at} to "
            f"{high:.5f} mm³ at {high_at}; the smallest standard uncertainty of a cell from {least * MM / UM:.1f} µm at "
            f"{least_at} to {most * MM / UM:.1f} µm at {most_at}.",
            finding=True,
        ),
        Table(table, "Reachable cells by their number of working sectors; numbers without a cell are left out"),
        _map_picture(
            study,
            plots.plot_flexibility(map_, new_axes(5.4, 6.6)),
            out,
            "flexibility",
            "Flexibility over the half-plane. The star is the working point of the sections above, turned into the plane.",
        ),
        _map_picture(
            study,
            plots.plot_comprehensive(map_, new_axes(5.4, 6.6)),
            out,
            "comprehensive",
            "Comprehensive accuracy volume over the half-plane; smaller is better.",
        ),
        _map_picture(
            study,
            plots.plot_uncertainty(map_, new_axes(5.4, 6.6)),
            out,
            "uncertainty",
            "Standard uncertainty of the position in the posture where it is smallest, among the centres of the working "
            "sectors; smaller is better. For distances this says more than the volume.",
        ),
        SceneView(
            map_scene(study.map, study.arm),
            "The half-plane with the arm's wrist in one cell after the other, in the most accurate posture of each.",
        ),
    ]


def _box_text(study: Study) -> str:
    """How the box of the map lies to the reach of the arm."""
    components, box = study.circle.components, np.asarray(study.map.data.attrs["extent_mm"])
    if components.wrist is None:
        return ""
    farthest = reach_of_wrist(components.wrist, components.swivel.shoulder)[1] / MM
    size = (
        f"The map ends at x = {box[1]:.0f} mm and z = {box[2]:.0f} and {box[3]:.0f} mm; the wrist reaches {farthest:.1f} mm."
    )
    if farthest <= box[1]:
        return f"{size} How many centres are out of reach depends on this box."
    return (
        f"{size} So the last {farthest - box[1]:.1f} mm of the reach are cut off, at z = 0 and at the axis; how many "
        "centres are out of reach depends on this box."
    )


def _map_picture(study: Study, axes: Axes, out: Path, name: str, caption: str) -> Picture:
    x, y, z = study.circle.point / MM
    axes.plot(np.hypot(x, y), z, "*", ms=13, mfc=plots.VERMILLION, mec="white")
    alt = f"Map of {study.arm.name} over distance from joint axis 1 and z: {name}"
    return picture(axes, out, name, alt, caption)


def _extreme(data: Any, name: str, pick: Any) -> tuple[float, str]:
    values = data[name].values
    i, k = np.unravel_index(pick(values), values.shape)
    where = f"x = {float(data['x_mm'][i]):.1f} mm, z = {float(data['z_mm'][k]):.1f} mm"
    return float(values[i, k]), where


def about_assumptions(study: Study) -> list[Part]:
    """What the numbers take for granted and what they leave out."""
    return [
        *([_sino6_assumptions()] if study.table2 is not None else []),
        Bullets(
            [
                "The errors of the parameters are taken as independent and, for u, as uniform within their half-widths. A "
                "half-width from repeated calibrations is read as a bound; correlations between parameters are not known.",
                "Only the geometry is uncertain in sections 3 to 5. Encoder noise, eccentricity, bending under gravity, "
                "temperature and the contact with the part are not in those numbers; a real arm is worse.",
                "Joints behind the fourth are held at zero. On SINO6 row 5 has a length of 0.04 mm, so the circle of the "
                "wrist depends a little on θ5.",
                "Volumes are first order in the errors; the Monte Carlo rows show how good that is in two postures.",
                "A cell of the map is judged at its centre and a sector at its centre; narrow gaps between centres go "
                "unseen.",
                "The volume says how much room the errors have, not how long they are: see u.",
                "Neither volume, u nor the largest deviation is a maximum permissible error of any standard.",
            ]
        ),
    ]


def _sino6_assumptions() -> Part:
    return (
        "The paper does not state, and the arm file assumes: the limits of joints 5 and 6, all masses and centres of mass, "
        "the axis of the stylus, and the mount. The masses enter what is said of gravity in the diagnosis of the paper's "
        "measurements, and no other number on this page; the axis of the stylus enters where the tip is in a "
        "seat. Gravity is "
        "taken along -z of the DH base, because the measured seats then stand above the table; elsewhere it "
        "decides only which elbow is called highest, from where the sectors of the swivel angle count."
    )
