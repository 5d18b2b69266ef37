"""Files of other people's layouts, one file per family of formats: what they hold, and reading of what is asked for.

Start with `contents.py`, what every reader returns. Nothing here knows of taps or labels.
"""
