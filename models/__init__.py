"""Recordings, classes and measurement models of taps: everything that precedes belief.

Start with `taps` (a set of taps), `grid` (the classes) and `touch` (generative model in NumPyro). `measurement`
holds the models, `io` the files. Nothing here depends on hardware, belief over time or studies.
"""
