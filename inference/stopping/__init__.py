"""When to decide.

Start with `stopping`, what all rules see and the paper's threshold; `rules` holds others.
"""
