"""`tune`: fixation point and threshold from training taps, or learned online.

Start at `report` and `online`, the public functions, then `run`. No search: `inference` holds the rules of choice.
"""
