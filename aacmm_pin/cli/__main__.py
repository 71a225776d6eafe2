"""``python -m aacmm_pin.cli`` is the command too."""

from aacmm_pin.cli import app

if __name__ == "__main__":
    app()
