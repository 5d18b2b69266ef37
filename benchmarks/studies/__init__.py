"""Studies on data of known truth, and results of commands on recordings: the numbers in the documentation.

Each module is a command; `--document` updates its tables and figures in a page.
"""
