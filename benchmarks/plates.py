"""Draws docs/reference/images/model-plates.svg: plate diagrams of all stories, from the NumPyro models themselves."""

from pathlib import Path

import numpy as np
from numpyro.infer.inspect import get_model_relations
from solidtouch.analysis.page.figure_style import save
from solidtouch.models.measurement import gaussian, matrix_normal, profile, profile_ar, profile_mvn, smooth, student
from solidtouch.models.measurement.fits.priors import CellPrior, Taps
from solidtouch.models.measurement.histogram import histogram_model
from studies.figure_stories import Story, plates

L, M, N, J, K, B, D = 2, 1, 6, 4, 3, 7, 5


def main() -> None:
    """Writes the picture."""
    generator = np.random.default_rng(0)
    where, what = np.repeat(np.arange(L), N // L), np.zeros(N, dtype=np.intp)
    taps = Taps(generator.normal(size=(N, J, K)), where, what, (L, M))
    cells = CellPrior(0.0, 1.0, 2.0, 2.0)
    kronecker = matrix_normal.KroneckerPrior(J + 2.0, np.eye(J), K + 2.0, np.eye(K), 1.0)
    curves = smooth.CurvePrior(np.ones((N, D)), np.ones((D, K)), np.full(K, 2.0), np.full(K, 2.0))
    models = {
        "histogram": (histogram_model, (generator.integers(B, size=(N, J, K)), where, what, (L, M, K, B), 0.01)),
        "gaussian": (gaussian.story, (taps, cells)),
        "student": (student.story, (taps,)),
        "profile": (profile.story, (taps, cells)),
        "profile-ar": (profile_ar.story, (taps, cells)),
        "profile-mvn": (profile_mvn.story, (taps, cells, np.zeros(K * (K - 1) // 2), 4.0)),
        "matrix-normal": (matrix_normal.story, (taps, kronecker)),
        "smooth": (smooth.story, (taps, curves)),
    }
    drawn = [Story(name, get_model_relations(story, arguments)) for name, (story, arguments) in models.items()]
    folder = Path(__file__).parent.parent / "docs" / "reference" / "images"
    png, _ = save(plates(drawn), folder, "model-plates")
    png.unlink()


if __name__ == "__main__":
    main()
