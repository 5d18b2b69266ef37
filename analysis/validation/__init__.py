"""`validate`: the checks of `correctness` and `conformance` on this installation, in one table.

Start at `report`, then `checks`. The only study that runs other studies; it stands above them.
"""
