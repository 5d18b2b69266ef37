"""Measurement models: the probability of a tap's samples under each class.

A model is one file, which `registry` knows and fits by name: start with `histogram`, the paper's, then
`story`, what the others consist of, and `profile`. `fits` holds what several need to find parameters, `likelihood` what
these mean for the bins of a tap. No belief is updated here.
"""
