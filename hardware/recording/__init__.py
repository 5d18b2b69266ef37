"""Recording sessions with a rig, which resume after an interruption.

Start with `collection` and `plan`; `recording` writes the taps. `models.io` reads recordings.
"""
