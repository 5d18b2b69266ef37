"""`trials`: any number of trials, counted on the way, with intervals over test taps."""
