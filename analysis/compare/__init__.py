"""`compare`: measurement models side by side, by prediction, classification and decisions.

Start at `run`, then `taps`, `classes` and `ranking`.
No model is defined here: the catalogue is in `models`.
"""
