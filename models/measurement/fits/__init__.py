"""What models share to find their parameters from training taps.

Start with `priors`, what a story takes; `cells` are levels and variances in closed form, `nuts` samples any story. What
one model alone needs is in its file.
"""
