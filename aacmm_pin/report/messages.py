"""The sentence of every note, by its code: the one place with such sentences.

A field names a value of the note's data. Behind its colon stands how it is written: a format;
a format and a unit for a value in SI (``.3g mm``; ``2 mm`` for two digits); ``#`` and a noun, to
count (``#record``); ``and``, to list; ``rows``, to list rows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from string import Formatter
from typing import Any

import numpy as np

from aacmm_pin._support.display import two_digits
from aacmm_pin._support.notes import Note
from aacmm_pin._support.units import DEG, MM, UM
from aacmm_pin.effects import listed
from aacmm_pin.report.numbers import count

UNITS = {"mm": (MM, " mm"), "µm": (UM, " µm"), "µrad": (UM, " µrad"), "°": (DEG, "°")}
"""Units of formats: how large they are, and what stands behind the number."""


def sentence(note: Note) -> str:
    """The sentence of a note, without a capital and a full stop.

    Raises:
        KeyError: its code is unknown, or a value that the sentence states is missing.
    """
    text = _Values().vformat(SENTENCES[note.code], (), note.data)
    place = note.data.get("place")
    return f"{place}: {text}" if place else text


class _Values(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        form, _, unit = format_spec.rpartition(" ")
        if unit in UNITS:
            size, written = UNITS[unit]
            number = two_digits(value / size) if form == "2" else format(value / size, form)
            return f"{number}{written}"
        if format_spec.startswith("#"):
            return count(value, format_spec[1:])
        if format_spec == "and":
            return listed([str(each) for each in value])
        if format_spec == "rows":
            return _runs(value)
        return format(value, format_spec)


def _runs(rows: Iterable[int]) -> str:
    """Rows in order, those in unbroken sequence by the first and the last."""
    numbers = np.array([*rows])
    starts = np.flatnonzero(np.diff(numbers) != 1) + 1
    words = []
    for first, *others in np.split(numbers, starts):
        words.append(f"{first} to {others[-1]}" if others else str(first))
    return ", ".join(words)


# fmt: off
SENTENCES: Mapping[str, str] = {
    # what a discrepancy acts on
    "tip_shifts_in_room": "the tip shifts in the room",
    "target_elsewhere": "the target sits elsewhere on the last body",
    "tip_shifts_before_joint": "the tip shifts along the body before joint {row}",
    "joint_angle_off": "the angle of joint {row} is off",
    "joint_position_off": "the position of joint {row} is off",
    "lengths_grow": "all lengths grow",
    "tubes_grow": "the long tubes grow",
    "tube_grows": "the tube of row {row} grows",
    # records
    "copies": "rows {rows:rows} are copies of other records and count once",
    "contacts_averaged": (
        "rows {rows:rows} are readings of {contacts:#held contact} and count as the means of these"
    ),
    "seats_by_coordinates": (
        "rows {rows:rows} have no seat and the same coordinates as others; they count as contacts "
        "of one seat"
    ),
    "few_postures": (
        "only {postures:#posture} in {records:#record}: nothing shows what depends on posture, and "
        "no held-out validation is possible"
    ),
    "held_postures": (
        "{records} records are of {postures} held postures, each with its own reference; errors "
        "that they share count as independent. Keep one record of each posture, or the mean"
    ),
    "columns_unused": "columns that no calibration uses: {columns:and}",
    "outside_known_range": (
        "{records} of {of} records are left out; they are outside the range of {cause}: rows "
        "{rows:rows}"
    ),
    "records_silent": (
        "{records:#record} without coordinates, and without a seat that others touch, contribute "
        "nothing"
    ),
    "angles_outside_limits": (
        "{records} of {of} records have angles a full turn outside the limits of joints "
        "{joints:and}; gains and error curves count angles as the limits do"
    ),
    "slide_units": (
        "joint {joint} slides: theta{joint}_rad holds metres, theta{joint}_deg metres times 180/π"
    ),
    "slide_scale_exact": (
        "the scale of joint {joint} is taken as exact: no coordinates and no bar of known length "
        "determine it"
    ),
    "temperatures_high": (
        "temperatures are {least:.4g} to {most:.4g} °C; check whether they are in Fahrenheit"
    ),
    "temperatures_low": (
        "temperatures are {least:.4g} to {most:.4g} °C; check whether they are differences from "
        "{reference:g} °C"
    ),
    "temperatures_other": (
        "temperatures are {least:.4g} to {most:.4g} °C, and the arm's lengths hold at "
        "{reference:.4g} °C. No thermal expansion is known: a metre of aluminium grows 23 µm per "
        "K, of steel 12 µm"
    ),
    "clock_odd": (
        "time_s is {least:.4g} to {most:.4g} s; a warm-up counts from 0, the moment of switching on"
    ),
    "markers_unknown": (
        "{arm} has no target with the markers {markers:and}; coordinates of such records are of "
        "the tip"
    ),
    "outside_fitted_range": (
        "{records} of {of} records are outside the {condition} to which {cause} was fitted, "
        "{low:.4g} to {high:.4g}; it stays as at the end"
    ),
    "before_slip": (
        "{records} of {of} records are before {cause} by the clock of the session in which it "
        "slipped ({time:.4g} s); a later session needs its own label in the column session"
    ),
    "after_slip": (
        "{records} of {of} records are later than {cause} by their session ({sessions:and})"
    ),
    "after_drift": (
        "{records} of {of} records are after {until:.4g} s, the end of the records that determined "
        "{cause}; u allows that it stops there or goes on"
    ),
    "tip_is_target": (
        "{cause}: coordinates are of the target, {distance:.4g mm} from the tip of the arm's "
        "geometry"
    ),
    "torques_large": (
        "torques reach {torque:.4g} N·m, but the masses of the arm give {weight:.3g} N·m; check "
        "whether they are in N·mm"
    ),
    "read_with": "the file was read with {ways:and}",
    "comments_ignored": "{lines:#line} left out, for they begin with # or sep=",
    "orientation_u_large": (
        "u_rot_rad is {u:g} rad at most, which is {u:.3g °}; check whether it is in degrees"
    ),
    "angles_like_radians": (
        "most angles lie within ±{turn:.4g}° of zero; if they are in radians, name the columns "
        "theta1_rad …"
    ),
    "labels_alike": (
        "labels in the column {column} are nearly the same but count as different: {labels}"
    ),
    "touches_no_reference": "coordinates of an acceptance test are not used as references",
    "touches_as_seats": (
        "touches of an acceptance test: {points:#single point} and the ends of {lengths:#length} "
        "count as seats; touches on spheres ({unused}) are not used"
    ),
    # noise
    "encoder_noise_estimated": "encoder noise not given; estimated with the scatter",
    "noise_estimated": (
        "noise of {of:and} not given: {scatter} of scatter per coordinate were found"
    ),
    "noise_enough": (
        "noise of {of:and} not given: the stated noise is enough for these records, and none was "
        "added"
    ),
    "seat_scatter_estimated": (
        "coordinates of the seats scatter by {scatter:.4f mm} each, as estimated"
    ),
    "few_seats": (
        "{seats:#seat} hardly determine the uncertainty of seat coordinates, on which U rests; "
        "state it (--reference-noise-mm, u_x_mm …)"
    ),
    "scatter_added": (
        "the records scatter more than stated: {scatter} per coordinate were added. A cause that "
        "the arm lacks moves the tips by about as much, and U does not contain it"
    ),
    "scatter_beyond_noise": "the records scatter by {scatter} per coordinate beyond their noise",
    "scatter_of_unstated_noise": (
        "the records scatter by {scatter} per coordinate and their noise was not stated"
    ),
    "scatter_too_large": (
        "a scatter of {scatter:.1f mm} is far more than an arm has; check the columns, their units "
        "and the reference frame"
    ),
    "reference_noise_small": (
        "the uncertainty of the references is stated as {u:.2g mm}, {times:.0f} times less than "
        "their residuals of {residual:.2g mm}; check its unit"
    ),
    "reference_noise_large": (
        "the uncertainty of the references is stated as {u:.2g mm}, {times:.0f} times more than "
        "their residuals of {residual:.2g mm}; check its unit"
    ),
    "bar_noise_assumed": (
        "uncertainty of bar lengths not given: taken as {u:g mm}; --length-noise-mm replaces it"
    ),
    # what the arm states, and what the records determine
    "uncertainty_assumed": (
        "uncertainty of {parameters} not given: taken as ±{length:g mm} and ±{angle:.0f °} for "
        "geometry; half-widths in the arm file replace it"
    ),
    "geometry_held": (
        "{held:#other geometric value} stay as in the file; their uncertainties count in u of the "
        "tip, not in those of the estimates"
    ),
    "records_used_before": (
        "{again} of these {records} records count twice: the calibration of {arm} used them "
        "already. Uncertainties are too small; use the arm before that calibration, or --no-prior"
    ),
    "standards_used_before": (
        "the calibration of {arm} used {standards} of these seat coordinates and bar lengths "
        "already; their errors count as new. U is too small, by up to √n after n such calibrations"
    ),
    "prior_left_unexplained": (
        "the calibration that {arm} comes from left something unexplained ({unexplained}). It may "
        "have moved parameters by more than their U; diagnose names it, --no-prior ignores that "
        "calibration"
    ),
    "stated_values_hold": (
        "without the uncertainties that the arm states, the scatter is {scatter:.4f mm}. "
        "{parameters:and} differ from the file by up to {off:.2g} u; if a part was exchanged or "
        "half-widths are too small, use --no-prior"
    ),
    "tip_undetermined": (
        "these records do not determine {parameters:and}, on which the tip depends. u of the tip "
        "contains their assumed widths; half-widths in the arm file, or records of the tip, reduce "
        "it"
    ),
    "target_becomes_tip": (
        "the target is {distance:.4g mm} from the tip of {arm} and becomes the tip of the "
        "calibrated arm. To keep the tip, label the target in the column marker"
    ),
    "temperature_of_lengths": (
        "the lengths of the calibrated arm hold at {temperature:.1f} °C, the mean of the records, "
        "no longer at {stated:g} °C; no thermal expansion is known"
    ),
    "not_converged": (
        "the search did not converge ({why}); results are of the best point that it found"
    ),
    # places that are contradicted
    "bar_length_off": (
        "all other data contradict the length of bar {bar} by {deviations:.2g} standard "
        "deviations; check its stated length"
    ),
    "seat_excluded": "all {records} excluded records touch seat {seat}, which may have moved",
    "seat_contradicted": (
        "seat {seat} has coordinates {apart:.4g mm} apart, in rows {rows:and}: it moved, or one is "
        "mistyped"
    ),
    "bar_contradicted": (
        "bar {bar} is {length:.6g mm} long, but the coordinates of its ends are {apart:.6g mm} "
        "apart: one of them is wrong"
    ),
    # diagnosis
    "contradicted_references": "{places}",
    "few_causes_shown": "these records would show only {seen} of {of:#cause} of typical magnitude",
    "cause_not_named": "{causes} would be found with {records:#record} more",
    "causes_below_zero": "nature has no {causes} below zero",
    "causes_unconfirmed": "held-out records do not confirm {causes}",
    "structure_left": "structure is left beyond chance ({chance})",
    "starts_disagree": "two explorations of the sets of causes found different ones",
    "more_causes": (
        "something acts that is not named (probability {probability}, threshold {threshold:g})"
    ),
    "explorations_disagree": (
        "two explorations of the sets of causes disagree: an inclusion probability differs by "
        "{difference:.2f}"
    ),
    "causes_not_tried": "{columns}",
    "excluded_would_show": (
        "all records together show {causes:and}, unless the excluded ones are gross errors; take "
        "more records near these"
    ),
    "on_top": "{cause}: its values come on top of those of {other}",
    "drift_slope": (
        "{cause}: these records hardly determine its time constant. After {until:.4g} s, when they "
        "end, it may stop or go on, which is in u then; take later records"
    ),
    "known_cause_gone": "{cause} was known as {was}, and is gone",
    "known_cause_changed": "{cause} was known as {was}, and has changed to {now}",
    "known_cause_beside": "{cause} was known as {was}; beside the new one it is {now}",
    "size_taken": (
        "no coordinates and no bar determine the arm's size: the length of {length} is taken as in "
        "the arm file"
    ),
    "value_below_zero": (
        "{cause}: {value} is negative beyond its U (k = 2), but nature has it above zero only. "
        "Another cause acts like it, or the sign of a gravity, torque or temperature is wrong"
    ),
    "partly_in_calibration": (
        "{causes:and}: the values hold if nothing of it acted during the earlier calibration, "
        "which would contain part of it; --no-prior does without that calibration"
    ),
    "masses_missing": (
        "{causes:and}: the arm file states no masses, so bending, bearings and stand were not "
        "tried; they may have a similar effect"
    ),
    "masses_exact": "{causes:and}: U takes the masses in the arm file as exact",
    "clock_restarts": (
        "time_s goes back in the file ({times} times): a clock that restarts needs labels in the "
        "column session"
    ),
    "clock_starts_late": (
        "time_s starts late: a warm-up counts from 0, the moment of switching on, and cannot be "
        "seen here"
    ),
    "clock_below_zero": (
        "time_s starts below 0: a warm-up counts from 0, the moment of switching on, and does "
        "nothing before"
    ),
    "noise_too_large": (
        "the residuals are far smaller than the stated noise (χ² {chi2:.0f} of {dof:.0f}); check "
        "its size and unit"
    ),
    "prior_ignored": (
        "the calibration of {arm} left something unexplained ({unexplained}); its uncertainties of "
        "parameters are not used"
    ),
    "depends_on": "something that no cause explains depends on {covariates:and}",
    "group_differs": (
        "{group} does not agree with the other records: its distance is {times:.1f} times theirs"
    ),
    "branches": "residuals of joint {joint} fall into two branches of ±{half_width:2 µrad}",
    "branches_of_slide": "residuals of joint {joint} fall into two branches of ±{half_width:2 µm}",
    "readings_scatter": "readings of joint {joint} scatter by {scatter:2 µrad} more than stated",
    "readings_of_slide_scatter": (
        "readings of joint {joint} scatter by {scatter:2 µm} more than stated"
    ),
    "postures_share_error": (
        "records of one posture share an error of {rms:2 µm} (RMS), {times} times that of a single "
        "record"
    ),
    "outlier": "outlier: farther off than the noise allows",
    # accuracy
    "taken_as_exact": "no uncertainty is stated for {parameters}, so these are taken as exact",
    "unexplained_not_in_u": (
        "u does not contain what the calibration of {arm} left unexplained: {unexplained}"
    ),
    "cells_without_sectors": (
        "{cells:#cell} in reach without a swivel angle that changes, as of an elbow in one plane, "
        "have no sectors; accuracy at a point lists the postures there"
    ),
    "first_joint_limited": (
        "joint 1 does not turn all the way round, so the map holds for the half-plane y = 0 alone"
    ),
    "first_axis_off_z": (
        "joint axis 1 is not the z axis of the base, so the map holds for the half-plane y = 0 "
        "alone"
    ),
    "gravity_off_first_axis": (
        "gravity is not along joint axis 1, so swivel angles start elsewhere in other half-planes"
    ),
    "joints_held": "joints are held where the limits are nearest to 0: {joints}",
    "extent_cuts_reach": "the extent leaves out points that the wrist reaches: {sides}",
    # postures
    "wrist_joint_held": "{held}; postures with other angles of it are not listed",
    "arm_degenerate": (
        "the arm is degenerate, or nearly: it is nearly singular in all postures, and some may be "
        "missed"
    ),
    "singular_unlisted": (
        "singular postures, such as {posture}, are not listed; they may continue in families"
    ),
    "singular_families_unlisted": (
        "{families} of {arrivals} arrivals are at singular postures that continue in families, "
        "such as {posture}; they are not listed"
    ),
    "search_ended": "the search ended at its limit of work, so there may be more components",
    "nearly_singular": (
        "singular or nearly singular postures: {postures:and}. A neighbour may be missed there, or "
        "one posture listed twice"
    ),
    "starts_stalled": (
        "{stalled} of {starts} starts stopped next to singular postures, where some may be missed"
    ),
    "curve_open": "component {component} could not be followed all the way round",
    "configurations_missing": (
        "{number:#configuration} between others of a curve could not be found"
    ),
    "stylus_axis_unreachable": (
        "the point is {distance:.3f mm} from the shoulder and cannot be reached with that stylus "
        "axis"
    ),
    "wrist_out_of_reach": (
        "the point is {distance:.3f mm} from the shoulder; the wrist reaches from {nearest:.3f mm} "
        "to {farthest:.3f mm}"
    ),
    # planning and acceptance
    "encoder_noise_assumed": "encoder noise not given; {noise:g} rad assumed",
    "reference_noise_assumed": (
        "reference noise not given; {noise:g mm} assumed where records state none"
    ),
    "records_not_counted": "{source} does not state {needs:and}, so its records do not count here",
    "causes_left_out": "{source} does not state {needs:and}, so {causes:and} are left out",
    "record_torques": "the compliance is of measured torques; record torque1_nm … too",
    "approach_both_sides": (
        "bring {joints} to the postures from both sides, as the approach columns state"
    ),
    "warm_room": "warm the room by {by:g} K for some of the records ({cool:g} °C and {warm:g} °C)",
    "measure_warm_up": (
        "switch the arm on cold and measure while it warms up, over {minutes:.0f} minutes"
    ),
    "hang_load": "hang {load:g} kg on the end of link {link}",
    "turn_mount": (
        "turn the mount by {degrees}° about the {axis} axis of the base (gravity_m_s2 = "
        "[{gravity}])"
    ),
    "planned_as_large_as": (
        "{cause} states no value; it is planned as large as it must be to look like {other} in the "
        "existing records ({option} states one)"
    ),
    "planned_at_typical_magnitude": (
        "{cause} states no value; it is planned at its typical magnitude, {size} ({option} states "
        "one)"
    ),
    "causes_inseparable": "the two do the same in every posture",
    "pairs_told_apart": (
        "{told} of {pairs} pairs of causes of typical magnitude are distinguished with odds of "
        "0.95 or more"
    ),
    "cause_never_shows": "{cause} would not show, nor would it with a load or on another mount",
    "cause_shows_otherwise": "{cause} would not show; it takes another set-up: {set_up}",
    "pair_never_told": (
        "no posture distinguishes {one} from {other}, nor would a load or another mount"
    ),
    "pair_told_otherwise": (
        "no posture distinguishes {one} from {other}; it takes another set-up: {set_up}"
    ),
    "old_records_excluded": "the old records are of another arm file and do not count in the odds",
    "cause_not_predicted": "not predicted, as no conditions are planned: {cause}",
    "figure_without_value": "no value; {error}",
    "mpe_of_other_standard": (
        "{figures:and}: no verdict in spite of the MPE, because only figures of {standard} were "
        "asked for"
    ),
    "guard_band_zero": (
        "{figures:and}: no uncertainty is stated or belongs to it, so the guard band is zero"
    ),
    "some_guard_bands_zero": (
        "{figures:and}: some uncertainties are not stated, and their guard bands are zero"
    ),
    "mpe_large": (
        "MPE of {figure}, {mpe:g mm}, is more than {times:g} times the value found; check whether "
        "it is in mm"
    ),
    "other_error_decides": (
        "{figure} by {source}: another error, {error:.4g mm} with U = {expanded:.4g mm}, {where}, "
        "decides the verdict"
    ),
    "measuring_range_unknown": (
        "measuring range not given; whether the longest length is 66 % of it was not checked"
    ),
    "touches_copied": (
        "{copies} of {touches} touches have the coordinates of another one; a copy contributes "
        "nothing"
    ),
    "test_small": (
        "all touches of {test} are within {extent:.3g mm}; check whether the coordinates are in mm"
    ),
    "test_small_in_range": (
        "all touches of {test} are within {extent:.3g mm}, but the measuring range is {range:.4g "
        "mm}; check whether the coordinates are in mm and the positions spread over the range"
    ),
    "position_small": (
        "all touches are within {extent:.3g mm}, those of the other positions within {others:.3g "
        "mm}; check whether its coordinates are in mm"
    ),
    "touch_off_sphere": (
        "{distance:.3g mm} from the sphere of the other touches, and not left out; it may be a "
        "mistouch"
    ),
    "touches_off_sphere": (
        "one of these touches is beside their sphere, whose form is {form:.3g mm}"
    ),
    "sphere_too_large": (
        "the sphere is too large by {difference:.4g mm} than feature_diameter_mm and "
        "probe_diameter_mm together. Check that coordinates are of the probe's centre and that "
        "both diameters are right and in mm"
    ),
    "sphere_too_small": (
        "the sphere is too small by {difference:.4g mm} than feature_diameter_mm and "
        "probe_diameter_mm together. Check that coordinates are of the probe's centre and that "
        "both diameters are right and in mm"
    ),
    # figures of an acceptance test
    "P_Form.Sph.1x25": (
        "range of the radial distances of 25 touches from their least-squares sphere; the worse of "
        "two positions"
    ),
    "P_Size.Sph.1x25": (
        "diameter of the least-squares sphere of 25 touches minus the calibrated one; the worse of "
        "two positions"
    ),
    "L_Dia.5x5": (
        "diameter of the smallest sphere round the centres of one sphere by five touches in each "
        "of five articulations"
    ),
    "E_Uni": "largest error of five lengths, each in seven positions three times",
    "E_Bi": (
        "largest error of five lengths touched from opposite sides, each in seven positions three "
        "times"
    ),
    "EffectiveDiameter": (
        "largest error of the diameter of a sphere touched nine times, in three repeats"
    ),
    "SPAT.Max": (
        "largest distance of a touch from the mean of one point in ten articulations; worst of "
        "three distances, 0 to 20, 20 to 80 and 80 to 100 % of the reach by public descriptions"
    ),
    "SPAT.2s": (
        "twice the standard deviation of one point in ten articulations; worst of three distances, "
        "0 to 20, 20 to 80 and 80 to 100 % of the reach by public descriptions"
    ),
    "Volumetric.Max": "largest error of two calibrated lengths in twenty positions",
    "Volumetric.2RMS": (
        "twice the root mean square error of two calibrated lengths in twenty positions"
    ),
    "SinglePoint.Sigma": (
        "standard deviation of the position of one point in ten articulations; the worst of three "
        "distances"
    ),
    "SinglePoint.Part": (
        "RMS distance from the mean of all touches, of those in postures predicted to be accurate; "
        "the worst distance"
    ),
    "SinglePoint.Rest": "the same of the other touches",
    # gross errors
    "gross_errors_unsought": "too few records to look for gross errors: all were used",
    "excluded_share": (
        "{excluded} of the {of} excluded records have {where}, and {others} of those used. Gross "
        "errors are scattered; these have a common cause that the model lacks"
    ),
    "joint_narrowed": (
        "the used records move joint {joint} over {used:.3g °}, all records over {seen:.3g °}: "
        "nothing is known of the rest"
    ),
    "slide_narrowed": (
        "the used records move joint {joint} over {used:.3g mm}, all records over {seen:.3g mm}: "
        "nothing is known of the rest"
    ),
    "excluded": "farther off than one good record in a hundred files would be",
    # mistakes in the input
    "unlike_arm": (
        "check the columns of angles and coordinates, their units and signs, the arm and the "
        "reference frame"
    ),
    "sessions_unlike": (
        "each session alone does, in its own frame; the arm or the references were moved between "
        "them"
    ),
    "orientation_scalar_last": "the scalar comes last, and has to come first",
    "orientation_inverse": "they are those of the reference frame in the tip's, not the other way",
    "orientation_unlike": "no other order of the four numbers explains it",
    "joint_angles_unit": (
        "the angles of joint {joint} alone are in {unit}, in the column theta{joint}_{column}"
    ),
    "zero_turned": "the zero of joint {joint} is turned: {degrees}° have to be added to its angles",
    "joints_exchanged": "the columns of joints {joints:and} are exchanged",
    "joint_reversed": "joint {joints:and} is counted the other way",
    "joints_reversed": "joints {joints:and} are counted the other way",
    "joint_shows_sum": "joint {joint} is shown as the sum of its angle and that of joint {before}",
    "joint_shows_difference": (
        "joint {joint} is shown as the difference of its angle and that of joint {before}"
    ),
    "angles_unit": "the angles are in {unit}, taken as {taken}",
    "coordinates_unit": "the coordinates are in {unit}, taken as {taken}",
    "coordinate_in_metres": "{axis} alone is in metres, in the column {axis}_mm",
    "bars_unit": "the lengths of the bars are in {unit}, taken as {taken}",
    "target_off_tip": (
        "the coordinates are of another point of the last body than the tip (--target unknown)"
    ),
    "other_frame": (
        "the coordinates are in another frame than the base's (--reference-frame external)"
    ),
    "coordinates_mirrored": (
        "the coordinates are a mirror image: two columns are exchanged, or one has the other sign"
    ),
    "other_axes": "the coordinates are along other axes: x, y, z should be {axes}",
    "other_convention": (
        'the numbers of the arm file are {other}, under convention = "{convention}"'
    ),
}
# fmt: on
