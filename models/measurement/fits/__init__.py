"""How the parameters of models other than the histogram are found from training taps.

Start with `cells`, where every class stands for itself; `curves` ties positions together, `nuts` samples any story.
The stories are in `measurement.stories`; what a fit is good for is not judged here.
"""
