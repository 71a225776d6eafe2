"""What the documentation makes of the package when it is built: pictures, tables, reference; and
what it checks.
"""
