"""A user's own causes: modules of ``--plugin``, and entry points of packages."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoints
from pathlib import Path
from types import ModuleType
from typing import Any

from aacmm_pin._support.text_escaping import note
from aacmm_pin.effects import CAUSES, raised
from aacmm_pin.errors import AacmmError

SEARCHED = [*sys.path]
"""Where modules are found, before plugins."""


def load_plugins(names: list[str], points: EntryPoints) -> None:
    """Import modules by name or path, and entry points.

    Raises:
        AacmmError: one cannot be imported.
    """
    for name in names:
        _load(f"--plugin {name}", partial(import_plugin, name))
    for point in points:
        _load(f"entry point {point.name}", point.load)


def _load(origin: str, load: Callable[[], Any]) -> None:
    registered = dict(CAUSES)
    try:
        with redirect_stdout(sys.stderr):  # what a module prints is no result
            load()
    except KeyboardInterrupt:
        raise
    except AacmmError as error:
        raise AacmmError(f"{origin}: {error}") from None
    except BaseException as error:
        file = os.path.abspath(origin.removeprefix("--plugin "))
        raise AacmmError(f"{origin}: {raised(error, file)}") from None
    if registered == CAUSES:
        note(f"{origin} registers no cause; call aacmm_pin.effects.register in this module")


def import_plugin(name: str) -> ModuleType:
    """Import a module by name or by the path of the file.

    Raises:
        AacmmError: no file, or its name, by which workers import it, is taken.
    """
    if not name.endswith(".py"):
        return importlib.import_module(name)
    path = Path(name).absolute()
    if not path.is_file():
        raise AacmmError("no such file; expected a module or a .py file")
    other = PathFinder.find_spec(path.stem, SEARCHED)
    taken = other is not None and other.origin != str(path)
    if taken or path.stem in sys.stdlib_module_names:
        raise AacmmError(f"{path.stem} is the name of an installed module; rename the file")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    if str(path.parent) not in sys.path:  # worker processes have the same
        sys.path.append(str(path.parent))
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def plugin_error(error: BaseException) -> str | None:
    """The error of a plugin in one line; None without plugins.

    If no line of a plugin is in the traceback, all are named: an attribute of a class may be wrong.
    """
    file_of_plugin = {
        cause.cause: getattr(sys.modules.get(cause.__module__), "__file__", None)
        for cause in CAUSES.values()
        if not cause.__module__.startswith("aacmm_pin.")
    }
    files = [frame.filename for frame in traceback.extract_tb(error.__traceback__)]
    for name, file in file_of_plugin.items():
        if file in files:
            return f"{name}: {raised(error, file)}"
    if not file_of_plugin or not isinstance(error, Exception):
        return None
    return f"{', '.join(file_of_plugin)}, or code that uses this cause: {raised(error, files[-1])}"
