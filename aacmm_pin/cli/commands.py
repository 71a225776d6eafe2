"""All subcommands, which are registered when their modules are imported."""

from aacmm_pin.cli import accuracy as accuracy
from aacmm_pin.cli import calibrate as calibrate
from aacmm_pin.cli import causes as causes
from aacmm_pin.cli import configurations as configurations
from aacmm_pin.cli import correct as correct
from aacmm_pin.cli import demo as demo
from aacmm_pin.cli import diagnose as diagnose
from aacmm_pin.cli import map as map
from aacmm_pin.cli import plan as plan
from aacmm_pin.cli import show as show
from aacmm_pin.cli import simulate as simulate
from aacmm_pin.cli import urdf as urdf
from aacmm_pin.cli.common import app

__all__ = ["app"]
