"""`sweep`: a grid of data sets, models and policies, on this machine or a Dask cluster. Start at `run`."""
