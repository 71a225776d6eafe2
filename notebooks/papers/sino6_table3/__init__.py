"""A diagnosis of Table 3 of the SINO6 paper, which prints six measured spreads.

The paper prints no records. Each cause is therefore a *pattern*: the spread of the positions at
each seat relative to the other seats. The size of a pattern is free.
"""
