"""`reproduce`: the experiment of the paper with its figures, tables and page. Start at `run`."""
