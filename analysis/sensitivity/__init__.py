"""`sensitivity`: what each choice that the paper leaves open is worth. Start at `run`."""
