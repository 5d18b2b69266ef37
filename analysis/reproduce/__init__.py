"""`reproduce`: the paper's experiment with its figures, tables and page.

Start at `run`, then `results` (what figures and tables are made of) and `summary`.
Trials are played by `analysis.experiment`, single episodes in `examples`.
"""
