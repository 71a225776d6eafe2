"""Postures and accuracy of articulated-arm coordinate measuring machines, on Pinocchio."""
