"""Diagnosis of files like those of real robots: several causes at once, structure that no cause
explains, and no stated noise.
"""
