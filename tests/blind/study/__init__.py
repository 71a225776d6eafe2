"""How well ``aacmm-pin diagnose`` finds hidden faults, over hundreds of blind files of many arms.

``python -m tests.blind.study`` draws the files (:mod:`blind.regimes`), hands each to the command
line alone, and only then looks at the truth: :mod:`~blind.study.runs` makes one row of the table
from one file, :mod:`~blind.study.outcomes` compares what was said with the truth and counts.
"""
