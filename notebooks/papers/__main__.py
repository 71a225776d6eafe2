"""Write the page of both papers with ``python -m papers papers.html``."""

import sys
from pathlib import Path

import numpy as np

from aacmm_pin.report.formats.html import page
from papers.document import papers_document
from papers.sino6.table2 import reproduce_table2
from papers.sino6_table3.diagnosis import diagnose_table3

SEED = 1

table3 = diagnose_table3(np.random.default_rng(SEED))
Path(sys.argv[1]).write_text(
    page(papers_document(reproduce_table2(), table3, SEED)), encoding="utf-8"
)
