"""Belief: how it is updated, moved, and acted upon.

Start with `reference`, the paper's equations in plain NumPy, then `episode`, one decision tap by tap. `engines` are
faster routes to the same belief, `moves` and `stopping` decide, `trials` plays many episodes, `tuning` learns settings.
"""
