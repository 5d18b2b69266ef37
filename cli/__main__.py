"""`python -m solidtouch.cli`, if the command is not on the path."""

from .main import program

program()
