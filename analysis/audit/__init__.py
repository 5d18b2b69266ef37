"""`audit`: where samples, taxels and taps depend on each other, and what helps. Start at `run`."""
