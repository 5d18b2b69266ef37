"""`tune`: fixation point and threshold from training taps. Start at `run`."""
