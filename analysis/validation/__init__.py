"""`validate`: the checks of this installation that `correctness` and `conformance` offer, in one table.

Start at `report`, then `checks`. The only study that runs other studies; it stands above them.
"""
