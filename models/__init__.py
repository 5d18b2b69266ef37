"""What is known of taps and objects before any belief: recordings, classes, and models of what a tap looks like.

Start with `taps` (a set of taps), `grid` (the classes) and `touch` (the story of a tap in NumPyro). `measurement`
holds the models, `io` the files. Nothing here knows of hardware, of belief over time or of studies.
"""
