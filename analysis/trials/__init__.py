"""`trials`: any number of trials, counted as they run, with intervals over test taps.

Start at `report`, then `spread`; `page` prints. No loops over trials: `inference` plays and counts them.
"""
