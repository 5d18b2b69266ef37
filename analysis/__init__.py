"""From results to claims: a folder for each study, and three that studies share.

`stats`, `experiment` and `page` are shared and import in this order only; start at the `run` of a study.
No study imports another: what two need moves to a shared folder, or the command combines them.
"""
