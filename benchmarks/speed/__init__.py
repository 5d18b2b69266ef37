"""Times beside baselines, other packages and limits of the machine.

Start with `run`, which measures all works and writes docs/reference/performance.md. A work is a module with a
function `rows`; `report` and `figures` show the rows. `sweep` and `sweep_start` are run by themselves.
"""
