"""What users wait for: whole commands, each a fresh process of the installed program, beside the limits set for them.

Start with `run`, which measures the rows of `works` and writes the block `commands` of docs/reference/performance.md.
`process` measures one process, `stages` says where its time goes; other Pythons run `gaussian_table` and `sampled`.
"""
