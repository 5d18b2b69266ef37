"""`sweep`: a grid of data sets, models and policies, on this machine or a Dask cluster.

Start at `run`, then `study` (the file), `cell` (one combination) and `store` (the result).
Nothing here draws figures.
"""
