"""Running times next to baselines, other packages and hardware limits.

Start with `run`, which measures every work and writes docs/reference/performance.md. A work is a module with a function
`rows`; `report` and `figures` present the rows. `sweep` and `sweep_start` are separate commands.
"""
