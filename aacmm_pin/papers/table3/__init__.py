"""The measured table of the SINO6 paper (its Table 3), diagnosed: shown, named, extended, and the gain measured.

Only aggregate figures are printed, so :mod:`aacmm_pin.papers.spread` stands in for the diagnosis of records.

- ``postures``: how the seats were touched, in three readings; ``causes``: what may have spread the records.
- ``contrast``: the marked ("green") part and the rest; ``strict_pick``: what they say however the part was chosen.
- ``seat6``: what could have made seat 6.
- ``extended``: the arm with encoder noise, and what that is worth on a seat left out.
- ``raw_records``: what the three hundred records behind the table would tell.
- ``result``: all of it; ``diagnose_table3`` makes it.
"""

from aacmm_pin.papers.table3.postures import READINGS, Reading, touched_seats
from aacmm_pin.papers.table3.raw_records import expected_of_records, simulated_records
from aacmm_pin.papers.table3.result import Table3Diagnosis, diagnose_table3

__all__ = [
    "READINGS",
    "Reading",
    "Table3Diagnosis",
    "diagnose_table3",
    "expected_of_records",
    "simulated_records",
    "touched_seats",
]
