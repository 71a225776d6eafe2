"""The templates of pages; text in them is escaped."""

from __future__ import annotations

import re
from functools import cache

import jinja2

_TIES = re.compile(
    r"(?<=[0-9=]) (?=(?:mm³|mm|µm|kB|%|°)(?!\w))|(?<==) (?=[-0-9])|(?<=[\wθζ]) (?==\s-?[0-9])"
)


@cache
def environment() -> jinja2.Environment:
    """The templates, which keep numbers and their units on one line."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("aacmm_pin.report", "templates"),
        autoescape=True,
        finalize=_kept_together,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _kept_together(value: object) -> object:
    """Text with non-breaking spaces at units and equals signs."""
    return _TIES.sub("\u00a0", value) if type(value) is str else value
