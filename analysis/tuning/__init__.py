"""`tune`: fixation point and threshold from training taps.

Start at `run`; `view` prints. No search: `inference` holds the rules of choice.
"""
