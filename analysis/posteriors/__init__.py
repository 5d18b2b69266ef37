"""Reference posteriors of the built-in models, by which draws of programs in any language are judged.

Start at `catalogue`, then `comparison`. The folder `data` is made by `benchmarks.posteriors.make`.
"""
