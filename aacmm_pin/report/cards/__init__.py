"""Cards: what Jupyter shows of an arm, a result, or anything else that this package gives to its users.

- ``card``: paragraphs, lists and tables, and :func:`html_of`, which finds the card of a value by its type.
- ``arms``: arms, their parameters, causes of error and conditions.
- ``measured``: measurements, calibrations, plans.
- ``accuracies``: postures, accuracies, maps, Monte Carlo.
- ``diagnoses``: diagnoses and their parts.
- ``papers``: the papers beside us.

To show another class, derive it from :class:`aacmm_pin._support.shown.Shown` and register a function for it here.
"""

from aacmm_pin.report.cards import accuracies, arms, diagnoses, measured, papers
from aacmm_pin.report.cards.card import html_of

__all__ = ["accuracies", "arms", "diagnoses", "html_of", "measured", "papers"]
