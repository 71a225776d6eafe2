"""The two papers that the project comes from, reproduced: equations, tables, and what differs from
the print.

The notebooks import it from their own folder; ``python -m papers papers.html``, run there, writes
all of it as a page.
"""

from papers import document

__all__ = ["document"]
