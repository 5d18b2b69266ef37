"""Results of an audit as plain numbers and text, for `audit.json` and the page.

A number that is missing or infinite is `None`; where an infinite factor has a meaning, `unbounded` says so.
"""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from ..page.labelled import rows
from ..page.page import Row
from ..stats.reliability import after_contacts, headline, interval_sentence, plain
from ..stats.right_exponent import Tuned, outside
from .answer import answer
from .checks import summarise_checks
from .guarantees import broken, guarantee_sentence
from .leakage.run import Leakage
from .remedy_scores import BeliefEvidence, Scored, lost
from .run import Audit, AuditSettings
from .variance.causes import SIZES, part_words, seen
from .verdict import (
    CAUSE_WORDS,
    MEASURING,
    calibration,
    cause_words,
    first_cause,
    ranking,
    recommended,
    verdict,
    worthwhile,
)

_ENDS = ("", "_low", "_high")
_TAXEL_TESTS = (
    "family_p",
    "drift_p",
    "contrasts",
    "drift_reason",
    "pairs",
    "rejected_fraction",
    "permutations",
    "reason",
)
_NO_COMPONENTS = "Variance components of gain and offset were not estimated, as in every preview (`--quick`)."
_SIZE_WORDS = {
    "design_effect": "design effect of the evidence of a tap, median over classes",
    "sequence_effect": "the same of a sequence, all classes",
    "gain_sd": "relative spread of tap strength",
    "timing_sd": "spread of the time of contact (samples)",
    "common_sd": "noise shared by taxels (unit of the samples)",
    "noise_sd": "noise of single taxels (unit of the samples)",
    "lasting_sd": "correlation of that noise from sample to sample",
}


def summarise(audit: Audit, settings: AuditSettings, about: Row) -> Row:
    """Everything that `audit.json` holds, without NaN or infinity."""
    setting, measured = settings.setting, audit.measured
    at_rest = headline(audit.measured.reliability, measured.policy, setting.play.threshold)
    state = calibration(measured.judged)
    cause = first_cause(audit.leakage, audit.split, audit.session_p, audit.samples_per_bin, state)
    titles = {remedy.name: remedy.title for remedy in audit.remedies}
    unit = audit.grid.what_error_unit
    within = "other taps of the training session" if audit.parts.of_one_session else MEASURING
    sentences = verdict(cause, measured, setting.play.threshold, titles, unit, within)
    sentences[0] += _other_sessions(audit)
    if audit.leakage.unjudged:
        sentences.insert(2, audit.leakage.unjudged)
    chosen = recommended(measured)
    summary = {
        "verdict": {
            "state": state,
            "sentences": sentences,
            "evidence": {"judged": _judged(measured.judged), "first_cause": cause.name, "remedy": chosen},
        },
        "first_cause": {
            "name": cause.name,
            "words": cause_words(cause.name),
            "sentence": cause.sentence,
            "evidence": {
                "leakage": _leakage(audit.leakage),
                "variance": _variance(audit.split, audit.session_p),
                "no_variance": audit.no_split,
                "taxels": _taxels(audit.taxels, by_session=audit.by_session),
                "times": _times(audit.times),
                "components": _components(audit),
                "predictive_checks": rows(summarise_checks(audit.checks), "statistic"),
                "samples_per_bin": audit.samples_per_bin,
            },
        },
        "miscalibration": {
            "factor": measured.judged.factor,
            "unbounded": _unbounded(measured.judged.factor),
            "state": state,
            "evidence": {
                "judged": _judged(measured.judged),
                "at_stopping": at_rest,
                "other_policy": {
                    str(policy): headline(audit.measured.reliability, str(policy), setting.play.threshold)
                    for policy in np.unique(audit.measured.reliability["policy"])
                    if policy != measured.policy
                },
                "after_taps": _after_taps(audit.measured.reliability),
                "guarantees": broken(audit.guarantees, measured.policy, setting.play.threshold),
                "exceeded": audit.exceeded,
                "guarantee_sentence": guarantee_sentence(audit.guarantees),
                "intervals": interval_sentence(audit.measured.reliability),
                "lost": lost(measured),
                "enough": [
                    {**one.design._asdict(), "right": one.right, "detectable": one.factor} for one in audit.enough
                ],
            },
        },
        "remedy": {
            "chosen": chosen,
            "setting": "setting.json",
            "model": "model.nc",
            "evidence": {
                "taps": measured.n,
                "reaction_time": measured.taps,
                "compared_at": measured.theta,
                "policy": measured.policy,
                "unit": unit,
                "as_it_is": _scored(measured.scores[0], audit),
                "ranking": [
                    {**_scored(score, audit), "worthwhile": worthwhile(measured, score)} for score in ranking(measured)
                ],
                "refused": audit.refused,
                "threshold": audit.recalibrated,
                "target_error": None if audit.target is None else audit.target.to_dict(),
            },
        },
        **about,
        "parts": audit.parts.description,
        "warnings": [*audit.parts.warnings, *about["warnings"]],
        "threshold": setting.play.threshold,
        "seed": settings.seed,
        "units": {"what": unit, "where": audit.grid.where_unit},
        "grid": {"L": audit.grid.L, "M": audit.grid.M},
        "causes": CAUSE_WORDS,
        "elapsed_s": audit.elapsed_s,
        "version": version("solidtouch"),
    }
    whole = _clean(summary)
    whole["verdict"]["short"] = answer(whole)
    return whole


def _judged(judged: BeliefEvidence) -> Row:
    """By what beliefs were called right or wrong, the factor of each object beside what a right model gives."""
    each = {
        name: {"factor": factor, "unbounded": _unbounded(factor), "beside": beside}
        for name, (factor, beside) in judged.each.items()
    }
    return {**judged._asdict(), "each": each, "unbounded": _unbounded(judged.factor)}


def _unbounded(factor: Sequence[float | None]) -> bool:
    """Whether a factor is infinite, which JSON cannot say."""
    return factor[0] is not None and bool(np.isinf(factor[0]))


def _other_sessions(audit: Audit) -> str:
    """What the tuning sessions say of errors, where they are others than the measuring one, or that there is none."""
    errors = audit.recalibrated.tuning
    if audit.parts.of_one_session:
        return " There is one session, so calibration on another day is unknown."
    if audit.parts.halved:
        return ""
    span = f"{min(errors):.1%}" + f" to {max(errors):.1%}" * (len(errors) > 1)
    who = "the tuning session" if len(errors) == 1 else f"the {len(errors)} tuning sessions"
    held = "; intervals cover other taps of these sessions, not other sessions"
    return f" In {who}, {span} of the decisions are wrong{held * (None not in audit.measured.judged.factor)}."


def _leakage(leaks: Leakage) -> Row:
    told = [
        {
            "quantity": name,
            "verdict": explains,
            "chance": leaks.told["chance"].sel(quantity=name),
            **{
                row["source"]: [row[key] for key in ("accuracy", "low", "high")]
                for row in rows(leaks.told.sel(quantity=name), "source")
            },
        }
        for name, explains in leaks.explains.items()
    ]
    return {
        "sentences": leaks.sentences,
        "judged": not leaks.unjudged,
        "before_contact": {"samples": leaks.before.samples, "known_by": leaks.before.known or None},
        "told": told,
        "blocks": leaks.blocks,
        "test_taps": leaks.test_taps,
    }


def _variance(split: xr.Dataset | None, session_p: float) -> Row | None:
    if split is None:
        return None
    keys = "suspects", "suspect_p", "suspect_follows_order"
    parts = [*(f"share{end}" for end in (*_ENDS, "_sure")), "ratio"]
    return {
        "parts": [
            {"words": part_words(row["name"]), **row} for row in rows(seen(split)[parts].rename(part="name"), "name")
        ],
        "sizes": [
            {"name": name, "words": _SIZE_WORDS[name], **{f"value{end}": split[name + end] for end in _ENDS}}
            for name in SIZES
        ],
        "session_p": session_p,
        **{name: value for name, value in split.attrs.items() if name not in keys},
        "suspects": [
            {"name": name, "p": p, "follows_order": follows}
            for name, p, follows in zip(*(split.attrs[key] for key in keys), strict=True)
        ],
    }


def _taxels(data: xr.Dataset, *, by_session: bool) -> Row:
    effects = {f"mean_absolute{end}": f"effect{end}" for end in (*_ENDS, "_null")}
    tests = data[[*effects, *_TAXEL_TESTS]].rename(effects)
    dead = np.flatnonzero(data["dead"].values).tolist()
    return {
        "tests": rows(tests, "test"),
        "dead": dead,
        "taxels": data.sizes["taxel"],
        "within_sessions": by_session,
    }


def _times(data: xr.Dataset) -> Row:
    def ends(name: str) -> list[xr.DataArray]:
        return [data[name + end] for end in _ENDS]

    return {
        "effective_samples": ends("effective_samples"),
        "effective_values": ends("effective_values"),
        "samples": data.sizes["lag"],
        "values": data.get("values"),
        "lag1": [one[1] for one in ends("autocorrelation")] if data.sizes["lag"] > 1 else None,
        "p": {str(test): data["p"].sel(test=test) for test in data["test"].values},
        "reason": data["reason"],
    }


def _components(audit: Audit) -> Row:
    found = audit.components
    if found is None:
        return {"sentences": [_NO_COMPONENTS], "converged": None, "standard_deviations": [], "effective_taps": []}
    return {
        "sentences": found.sentences,
        "converged": found.converged,
        "standard_deviations": rows(found.summary, "quantity", "component"),
        "effective_taps": rows(found.effective, "n"),
    }


def _after_taps(data: xr.Dataset) -> list[Row]:
    part = after_contacts(data).transpose("contacts", "what", ...)
    names = ("wrong", "doubt", "calibration_error", "log_loss", "brier", "factor")
    values = {name: np.stack([part[name + end].values for end in _ENDS], axis=-1).tolist() for name in names}
    return [
        {
            "taps": n,
            **{str(what): {name: values[name][i][j] for name in names} for j, what in enumerate(part["what"].values)},
        }
        for i, n in enumerate(part["contacts"].values)
    ]


def _scored(score: Scored, audit: Audit) -> Row:
    remedy = next(remedy for remedy in audit.remedies if remedy.name == score.name)
    return {
        **score._asdict(),
        "unbounded": _unbounded(score.factor),
        "gain_per_tap": None if score.gain is None else [value / audit.measured.n for value in score.gain],
        "title": remedy.title,
        "assumes": remedy.assumes,
        "how": remedy.how,
        "power": remedy.model.exponent,
        "saturation": remedy.setting.fit.saturation,
        "right_model": None if remedy.beside is None else _tuned(remedy.beside),
    }


def _tuned(tuned: Tuned) -> Row:
    """What was tuned beside what a right model gives; a saturation of `MOST_TAPS` is none."""
    sides = {
        name: None if one is None else {**one._asdict(), "outside": outside(one)}
        for name, one in (("power", tuned.power), ("saturation", tuned.saturation))
    }
    return {"sentence": tuned.sentence, **tuned._asdict(), **sides}


def _clean(value: Any) -> Any:
    """The same without NaN, infinities, records and NumPy's numbers, which JSON does not take."""
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        value = value._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(value, Mapping):
        return {str(key): _clean(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_clean(item) for item in value]
    if isinstance(value, np.generic | xr.DataArray):
        value = value.item()
    return plain(value) if isinstance(value, float) else value
