"""The whole tour on bundled input: an arm, its postures at a point, its accuracy there and over the workspace, as a page.

Every number in the text of the page is computed when the page is made; the sentences around them are fixed.
"""

from aacmm_pin.report.demo.run import DemoSummary, run_demo

__all__ = ["DemoSummary", "run_demo"]
