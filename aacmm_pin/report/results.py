"""Display of results; :mod:`aacmm_pin` hands this module to :mod:`aacmm_pin._support.display`.

To show a class of your own, derive it from :class:`aacmm_pin._support.display.Shown`, and register
a function that makes its :class:`~aacmm_pin.report.document.Document` with
``document_of.register``.
"""

from __future__ import annotations

from pathlib import Path

from aacmm_pin._support.output_files import whole_file
from aacmm_pin.report import (
    acceptance_page,
    accuracy_page,
    arm_page,
    calibration_page,
    diagnosis_json,
    diagnosis_notes,
    diagnosis_page,
    measurements_page,
    plan_page,
    plots,
    procedure_page,
    residual_tables,
)
from aacmm_pin.report.document import document_of
from aacmm_pin.report.formats import content, require_format
from aacmm_pin.report.formats.html import fragment

__all__ = [
    "acceptance_page",
    "accuracy_page",
    "arm_page",
    "calibration_page",
    "diagnosis_json",
    "diagnosis_notes",
    "diagnosis_page",
    "html_of",
    "measurements_page",
    "plan_page",
    "plots",
    "procedure_page",
    "residual_tables",
    "write",
]


def html_of(result: object) -> str:
    """HTML of a result for Jupyter.

    Raises:
        TypeError: its class has no document.
    """
    return fragment(document_of(result))


def write(result: object, path: str | Path, force: bool = False) -> None:
    """Write the document of a result, as ``write(found, "report.html")``, in the format of the
    suffix.

    Raises:
        OutputError: the file exists and ``force`` is False, cannot be written, or has no format.
        TypeError: the class of the result has no document.
    """
    require_format(path)
    with whole_file(path, force) as temporary:
        temporary.write_bytes(content(document_of(result), path))
