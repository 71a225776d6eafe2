"""The equations and tables of the two source papers, reproduced and corrected.

The notebooks import this package from their own folder. In this folder, ``python -m papers
papers.html`` writes a page with all results.
"""

from papers import document

__all__ = ["document"]
