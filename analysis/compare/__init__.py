"""`compare`: measurement models side by side. Start at `run`."""
