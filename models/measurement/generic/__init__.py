"""Measurement models given by one NumPyro function, the user's or a built-in one.

`contract` says what the function takes; `story` fits it, `form` gives its likelihood. Nothing here may know a model by
its name, and importing `contract` or `source` must not import JAX.
"""
