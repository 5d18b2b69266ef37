"""Studies on data whose truth is known, and what commands find on recordings: the numbers of the documentation.

Each module is a command; with `--document` it rewrites its tables and figures in a page.
"""
