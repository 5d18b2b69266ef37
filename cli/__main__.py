"""`python -m solidtouch.cli`, for where the command is not on the path."""

from .main import run

run()
