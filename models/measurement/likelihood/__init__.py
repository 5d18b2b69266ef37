"""From parameters to the log probability of the bins of taps, fast and exact in the tails.

Start with `bins`, then `forms`; `shapes` makes forms of parameters. `binned` and `story_likelihood` say the
same in JAX, by which they are checked. Nothing here is fitted.
"""
