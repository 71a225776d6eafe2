"""What the commands about acceptance tests share: the arms, the standard and the MPEs."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from aacmm_pin._support.input_files import content_of
from aacmm_pin._support.plausible import MPE
from aacmm_pin._support.units import MM, number
from aacmm_pin.arm import MOST_BYTES, toml_of
from aacmm_pin.cli.arm_options import UrdfArm
from aacmm_pin.effects import ErrorModel
from aacmm_pin.errors import AacmmError
from aacmm_pin.verification import StandardName

Standard = Annotated[
    StandardName | None, typer.Option(help="Use this standard only. Default: both standards.")
]
Mpe = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CHARACTERISTIC=MM",
        help="Maximum permissible error (MPE) of a characteristic, or a TOML file of MPEs "
        "(repeatable).",
    ),
]


def files_argument(help_: str) -> Any:
    """The arguments ``[ARM]... DATA``."""
    return typer.Argument(metavar="[ARM]... DATA", help=help_)


def arms_of(names: list[str], robot: UrdfArm) -> dict[str, ErrorModel]:
    """The arms by what they are called at the command line.

    Raises:
        AacmmError: an arm cannot be used.
    """
    arms = {name: ErrorModel.load(name) for name in names}
    by_urdf = robot.of_urdf()
    if by_urdf is not None:
        arms[str(robot.urdf)] = by_urdf
    return arms


def limits_of(texts: list[str]) -> dict[str, float]:
    """MPEs by name of the characteristic [m], each from ``CHARACTERISTIC=MM`` or a file of them.

    Raises:
        AacmmError: one is no number, or a file cannot be read.
    """
    given: dict[str, object] = {}
    for text in texts:
        for name, limit in _stated(text).items():
            if name in given:
                raise typer.BadParameter(
                    f"--mpe states {name} twice; expected each characteristic once"
                )
            given[name] = limit
    return {name: _limit(name, limit) for name, limit in given.items()}


def _stated(text: str) -> dict[str, Any]:
    """What one ``--mpe`` states, by name of the characteristic."""
    name, equals, value = text.partition("=")
    if equals:
        return {name: value}
    if Path(text).suffix != ".toml" and not Path(text).exists():
        raise typer.BadParameter(
            f"--mpe {text}: expected CHARACTERISTIC=MM, such as E_Uni=0.1, or a TOML file of MPEs"
        )
    refused = partial(_refused, text)
    return toml_of(content_of(text, MOST_BYTES, "a TOML file of MPEs", refused), refused)


def _refused(path: str, message: str) -> AacmmError:
    return AacmmError(f"{path}: {message}")


def _limit(name: str, value: object) -> float:
    """An MPE [m]."""
    try:
        limit = number(str(value))
    except ValueError:
        raise AacmmError(
            f"MPE of {name}: {value!r}; expected a number in mm with a decimal point"
        ) from None
    MPE.of_unit("mm", MM).check(limit, f"MPE of {name}")
    return limit * MM
