"""The measured table of the SINO6 paper (its Table 3), diagnosed as far as six printed spreads allow.

Only aggregate figures are printed, so a cause is a *pattern* here: how much it would spread the indications at one seat
relative to the others; its size is free.
"""

from aacmm_pin.papers.sino6_table3.diagnosis import Table3Diagnosis, diagnose_table3
from aacmm_pin.papers.sino6_table3.marked_records import implied_counts
from aacmm_pin.papers.sino6_table3.patterns import of_encoder_noise
from aacmm_pin.papers.sino6_table3.seats import TouchedSeats, touched_seats

__all__ = [
    "Table3Diagnosis",
    "TouchedSeats",
    "diagnose_table3",
    "implied_counts",
    "of_encoder_noise",
    "touched_seats",
]
