"""Checked arrays, units, files written whole, progress, threads: no user needs them."""
