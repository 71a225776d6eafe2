"""Arm files as text: what :func:`aacmm_pin.arm.file.parse_arm_file` reads back."""

from __future__ import annotations

from typing import Any

import tomli_w

from aacmm_pin.arm.file import ArmFile


def arm_text(arm: ArmFile, comment: str = "") -> str:
    """TOML of ``arm``, with ``comment`` in front; numbers are written so that they come back to the last bit."""
    content = _plain(arm.model_dump(by_alias=True, exclude_none=True, exclude_defaults=True))
    content = {"schema": arm.schema_, **content}
    lines = [f"# {''.join(c if c.isprintable() else ' ' for c in line)}".rstrip() for line in comment.splitlines()]
    return "\n".join([*lines, *([""] if lines else []), tomli_w.dumps(content)])


def _plain(value: Any) -> Any:
    """Tuples become lists."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value
