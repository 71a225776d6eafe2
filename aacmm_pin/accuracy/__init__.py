"""What uncertainty of an arm's parameters and indications does to its tip: at a posture, on a
circle, over the workspace.
"""
