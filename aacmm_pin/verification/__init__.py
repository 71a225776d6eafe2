"""Whether an arm meets its specification: figures of the standards from touches, against maximum permissible errors."""

from aacmm_pin.verification.accept import AcceptanceResult, accept

__all__ = ["AcceptanceResult", "accept"]
