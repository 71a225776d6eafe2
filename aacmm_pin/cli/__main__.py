"""``aacmm-pin`` and ``python -m aacmm_pin.cli``: streams and signals, before the rest is
imported.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings


def main() -> None:
    # Open standard streams that the caller closed, lest files opened later take their numbers.
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    # No warning of a library ends a command, or a worker process of it.
    os.environ.pop("PYTHONWARNINGS", None)
    sys.warnoptions.clear()
    warnings.resetwarnings()
    # Shells ignore SIGINT for jobs in the background, which stays so.
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
        # While compiled code is loaded, no handler of Python's would run.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from aacmm_pin.cli.root_command import app

    app()


if __name__ == "__main__":
    main()
