"""Statistics shared by several studies: intervals, pairing, reference distributions, reliability.

Start at `metrics`, then `jackknife`, `decisions` and `reliability`.
The lowest folder of `analysis`: no pages, no settings of a study, no import of its neighbours.
"""
