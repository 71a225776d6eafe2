"""Postures with which an arm reaches a point or a pose: the configuration circle, and what limits
leave of it.
"""
