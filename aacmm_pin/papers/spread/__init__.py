"""Aggregate measurements: what the spread of a seat touched in many postures says of causes of error, and what it cannot.

Where only standard deviations are published and no records, the diagnosis of records has nothing to work on. Here a cause
is a *pattern*: how much it would spread the indications at one seat relative to the others. Its size is free.

- ``seats``: the seats and the postures in which they were touched.
- ``pattern``, ``causes``: what every cause of :mod:`aacmm_pin.effects`, the stated uncertainties or noise predict.
- ``evidence``: likelihood of observed spreads, Bayes factors, leave-one-seat-out predictions.
- ``selection``: parts chosen before or after measuring.
- ``records``: how well the records themselves, not their spreads, would tell the causes apart.
"""

from aacmm_pin.papers.spread.causes import of_effects, of_encoder_noise, of_local_noise, of_stated_uncertainty
from aacmm_pin.papers.spread.evidence import Evidence, evidence, left_out, predictive, probabilities
from aacmm_pin.papers.spread.pattern import Pattern, mixed
from aacmm_pin.papers.spread.records import Kernel, expected_log_bayes_factors, kernel_of_effects, kernel_of_noise
from aacmm_pin.papers.spread.seats import TouchedSeats
from aacmm_pin.papers.spread.selection import part_and_rest

__all__ = [
    "Evidence",
    "Kernel",
    "Pattern",
    "TouchedSeats",
    "evidence",
    "expected_log_bayes_factors",
    "kernel_of_effects",
    "kernel_of_noise",
    "left_out",
    "mixed",
    "of_effects",
    "of_encoder_noise",
    "of_local_noise",
    "of_stated_uncertainty",
    "part_and_rest",
    "predictive",
    "probabilities",
]
