"""Names of the engines that answer cases."""

ROUTES = ("numpy", "numpyro", "montecarlo")
"""That of the Monte Carlo is the compiled filter, whose whole trials `trials` compares."""
