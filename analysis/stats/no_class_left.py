"""Sentences about trials in which no class was left."""

from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel


def impossible_cause(model: TapModel) -> str:
    """Why a tap can be impossible under every class of a model, in a sentence."""
    if isinstance(model, HistogramModel) and model.pseudocount == 0:
        return "Without a pseudocount, a sample in an empty bin is impossible; use --pseudocount above 0."
    return f"The {model.name} model gives some bins probability 0."


def no_class_left_sentence(share: float, model: TapModel) -> str:
    """How often trials ended so, what counts as their decision, and why."""
    return (
        f"No class left: up to {share:.1%} of the trials ended undecided, because a tap was impossible under every "
        f"remaining class; they count with the classes most probable before that tap. {impossible_cause(model)}"
    )
