"""Plumbing that no user needs: checked arrays, units, files written whole, progress, threads."""
