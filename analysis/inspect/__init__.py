"""`inspect`: what a recording holds. Start at `run`."""
