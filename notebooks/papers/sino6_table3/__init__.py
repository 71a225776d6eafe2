"""The measured table of the SINO6 paper (its Table 3), diagnosed as far as six printed spreads
allow.

Only aggregate figures are printed, so a cause is a *pattern* here: how much it would spread the
indications at one seat relative to the others; its size is free.
"""
