"""Measurement models: the probability of a tap's samples under each class.

Start with `model`, what all can do, then `histogram`, the paper's; `catalogue` fits any of them by name. `fits` says
how parameters are found, `likelihood` what they mean for the bins of a tap. No belief is updated here.
"""
