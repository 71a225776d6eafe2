"""The command ``aacmm-pin``: one function for each subcommand, no logic of its own."""

from aacmm_pin.cli import before as before
from aacmm_pin.cli import diagnosed as diagnosed
from aacmm_pin.cli import measured as measured
from aacmm_pin.cli import planned as planned
from aacmm_pin.cli import shown as shown
from aacmm_pin.cli.common import app

__all__ = ["app"]
