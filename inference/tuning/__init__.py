"""Settings learned from taps: exponent, threshold, fixation, online or held out.

Start with `tempering`, the exponent of Eq. 1, and `held_out`. Whether a setting is any good is for `analysis`.
"""
