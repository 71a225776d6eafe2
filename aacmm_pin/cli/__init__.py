"""The command ``aacmm-pin``: one file for each subcommand, no logic of its own; imported without
loading any of them.
"""
