"""The documentation: ``sphinx-build -W --keep-going notebooks/site out/site``; nothing is read from
the network.
"""

from __future__ import annotations

import sys
from pathlib import Path

SITE = Path(__file__).parent
sys.path.insert(0, str(SITE))

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

import aacmm_pin

project = "aacmm_pin"
author = "The aacmm_pin authors"
copyright = author
version = release = aacmm_pin.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "building.docstrings",
    "building.generated",
    "building.names",
    "building.check",
]
exclude_patterns = ["building"]
nitpicky = True
smartquotes = False  # of --tip they would make a dash

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
add_module_names = False
maximum_signature_line_length = 80


def setup(app: Sphinx) -> None:
    """Tables of text have no grammar."""
    app.add_lexer("csv", TextLexer)


html_theme = "furo"
html_title = f"aacmm_pin {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
