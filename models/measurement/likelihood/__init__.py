"""From parameters to the log probability of the bins of taps, fast and exact in the tails.

Start with `forms`; `shapes` makes them of parameters, `bins` cuts samples. `binned` and `story_likelihood` say the
same in JAX, by which they are checked. Nothing here is fitted.
"""
