"""Shared methods to estimate the parameters of models from training taps.

Start with `priors`, the arguments of generative models; `cells` fits levels and variances in closed form, `nuts`
samples any model. Code for a single model is in its file.
"""
