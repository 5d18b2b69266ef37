"""`sensitivity`: the effect of each choice that the paper leaves open.

Start at `choices`, then `run` and `effects` (paired differences and verdicts).
No rule of the paper's default reading: those are in `inference`.
"""
