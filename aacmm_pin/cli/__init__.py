"""``aacmm-pin``: one module for each subcommand, imported when it runs."""
