"""Studies: a folder for each, and three folders that they share.

`stats`, `experiment` and `page` are shared and import in this order only; start at the `run` of a study.
No study imports another: what two need moves to a shared folder, or the command combines them.
"""
