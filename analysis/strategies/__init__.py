"""`strategies`: how to move and when to stop, and the regret against the exact rule. Start at `run`."""
