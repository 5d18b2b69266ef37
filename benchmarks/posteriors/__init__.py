"""Makes the reference posteriors of the built-in models, and studies the verdict on draws of other programs.

Start at `targets`, what is known of each model; `make` writes `analysis/posteriors/data`. `level` measures how often
right draws are called wrong, and wrong ones right; `programs` runs models written in Stan and PyMC.
"""
