"""The measured table of the SINO6 paper (its Table 3): predicted, and diagnosed as far as six printed spreads allow.

Only aggregate figures are printed, so a cause is a *pattern* here: how much it would spread the indications at one seat
relative to the others; its size is free.

- ``seats``: how the seats were touched, in three readings; ``predicted``: spreads by DH errors and by angle noise.
- ``patterns``, ``causes``, ``evidence``: what each cause would spread, and how well that agrees with the print.
- ``parts``: the marked part and the rest; ``diagnosis``: all of it, the extended arm and the gain on a seat left out.
- ``records``: what the three hundred records behind the table would tell.
"""

from aacmm_pin.papers.sino6_table3.diagnosis import Table3Diagnosis, diagnose_table3
from aacmm_pin.papers.sino6_table3.patterns import of_encoder_noise
from aacmm_pin.papers.sino6_table3.predicted import Table3, implied_counts, predict_table3
from aacmm_pin.papers.sino6_table3.records import expected_of_records, simulated_records
from aacmm_pin.papers.sino6_table3.seats import TouchedSeats, touched_seats

__all__ = [
    "Table3",
    "Table3Diagnosis",
    "TouchedSeats",
    "diagnose_table3",
    "expected_of_records",
    "implied_counts",
    "of_encoder_noise",
    "predict_table3",
    "simulated_records",
    "touched_seats",
]
