"""Results of an audit as plain numbers and text, for `audit.json` and the page."""

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from ..stats.reliability import after_contacts, headline, interval_sentence, plain
from ..stats.right_exponent import Tuned, outside
from ..stats.right_model import Beside
from .checks import summarise_checks
from .guarantees import PromiseTest, broken, guarantee_sentence
from .leakage.run import Leakage
from .record import (
    AfterTapsRow,
    AuditedData,
    AuditSummary,
    BesideRecord,
    ComponentRow,
    ComponentsRecord,
    EnoughRow,
    FactorRecord,
    JudgedRecord,
    LeakageRecord,
    OutsideRecord,
    PartRow,
    PromiseRecord,
    RefusedRow,
    RemedyRow,
    SizeRow,
    SuspectRow,
    TaxelsRecord,
    TaxelTest,
    ThresholdRecord,
    TimesRecord,
    TunedRecord,
    VarianceRecord,
)
from .remedy_scores import BeliefEvidence, Scored, lost
from .run import Audit, AuditSettings
from .variance.causes import SIZES, part_words, suspect_part
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

_SIZE_WORDS = {
    "design_effect": "design effect of the evidence of a tap, median over classes",
    "sequence_effect": "the same of a sequence, all classes",
    "gain_sd": "relative spread of tap strength",
    "timing_sd": "spread of the time of contact (samples)",
    "common_sd": "noise shared by taxels (unit of the samples)",
    "noise_sd": "noise of single taxels (unit of the samples)",
    "lasting_sd": "correlation of that noise from sample to sample",
}


def summarise(audit: Audit, settings: AuditSettings, about: AuditedData) -> AuditSummary:
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
    summary: AuditSummary = {
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
                "predictive_checks": _checks(audit.checks),
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
                "exceeded": {name: _promise(promise) for name, promise in audit.exceeded.items()},
                "guarantee_sentence": guarantee_sentence(audit.guarantees),
                "intervals": interval_sentence(audit.measured.reliability),
                "lost": lost(measured),
                "enough": [
                    EnoughRow(**one.design._asdict(), right=one.right, detectable=one.factor) for one in audit.enough
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
                "refused": [RefusedRow(**item._asdict()) for item in audit.refused],
                "threshold": ThresholdRecord(**audit.recalibrated._asdict()),
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
    return _clean(summary)


def _judged(judged: BeliefEvidence) -> JudgedRecord:
    """By what beliefs were called right or wrong, the factor of each object beside what a right model gives."""
    each: dict[str, FactorRecord] = {
        name: {"factor": factor, "unbounded": _unbounded(factor), "beside": BesideRecord(**beside._asdict())}
        for name, (factor, beside) in judged.each.items()
    }
    return {
        "factor": judged.factor,
        "wrong": judged.wrong,
        "beside": BesideRecord(**judged.beside._asdict()),
        "exact": judged.exact,
        "each": each,
        "taps": judged.taps,
        "few": judged.few,
        "unbounded": _unbounded(judged.factor),
    }


def _unbounded(factor: Sequence[float | None]) -> bool:
    """Whether a factor is infinite, which JSON cannot say."""
    return factor[0] is not None and bool(np.isinf(factor[0]))


def _promise(promise: PromiseTest) -> PromiseRecord:
    beside = promise.beside
    return {"exceeded": promise.exceeded, "beside": None if beside is None else BesideRecord(**beside._asdict())}


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


def _leakage(leaks: Leakage) -> LeakageRecord:
    rows = []
    for quantity in leaks.told["quantity"].values:
        at = leaks.told.sel(quantity=quantity)
        rows.append(
            {
                "quantity": str(quantity),
                "verdict": leaks.explains[str(quantity)],
                "chance": float(at["chance"]),
                **{
                    str(source): [float(at[name].sel(source=source)) for name in ("accuracy", "low", "high")]
                    for source in at["source"].values
                },
            }
        )
    return {
        "sentences": list(leaks.sentences),
        "judged": not leaks.unjudged,
        "before_contact": {"samples": leaks.before.samples, "known_by": leaks.before.known or None},
        "told": rows,
        "blocks": leaks.blocks,
        "test_taps": leaks.test_taps,
    }


def unseen_parts(split: xr.Dataset) -> set[str]:
    """Parts of the variance of evidence that these taps cannot show."""
    unseen = {"place", "order"} - {split.attrs["covariate"]}
    if split.attrs["sessions"] < 2:
        unseen |= {"session", "serial"}
    suspects = zip(split.attrs["suspects"], split.attrs["suspect_p"], strict=True)
    return unseen | {suspect_part(name) for name, p in suspects if not np.isfinite(p)}


def _variance(split: xr.Dataset | None, session_p: float) -> VarianceRecord | None:
    if split is None:
        return None
    unseen = unseen_parts(split)
    suspects: list[SuspectRow] = [
        {"name": name, "p": p, "follows_order": follows}
        for name, p, follows in zip(
            *(split.attrs[key] for key in ("suspects", "suspect_p", "suspect_follows_order")), strict=True
        )
    ]
    about = {name: value for name, value in split.attrs.items() if not name.startswith("suspect")}
    rows = [
        PartRow(
            name=part,
            words=part_words(part),
            **{
                f"share{end}": None if part in unseen else float(split[f"share{end}"].sel(part=part))
                for end in ("", "_low", "_high", "_sure")
            },
            ratio=None if part in unseen else float(split["ratio"].sel(part=part)),
        )
        for part in map(str, split["part"].values)
    ]
    sizes = [
        SizeRow(name=name, words=_SIZE_WORDS[name], **{f"value{end}": float(split[name + end]) for end in _ENDS})
        for name in SIZES
    ]
    return VarianceRecord(parts=rows, sizes=sizes, session_p=session_p, **about, suspects=suspects)


_ENDS = ("", "_low", "_high")


def _taxels(data: xr.Dataset, *, by_session: bool) -> TaxelsRecord:
    tests = []
    for name in data["test"].values:
        at = data.sel(test=name)
        tests.append(
            TaxelTest(
                test=str(name),
                **{f"effect{end}": float(at[f"mean_absolute{end}"]) for end in _ENDS},
                effect_null=float(at["mean_absolute_null"]),
                family_p=float(at["family_p"]),
                drift_p=float(at["drift_p"]),
                contrasts=int(at["contrasts"]),
                drift_reason=str(at["drift_reason"].values),
                pairs=int(at["pairs"]),
                rejected_fraction=float(at["rejected_fraction"]),
                permutations=int(at["permutations"]),
                reason=str(at["reason"].values),
            )
        )
    dead = np.flatnonzero(data["dead"].values).tolist()
    return {"tests": tests, "dead": dead, "taxels": data.sizes["taxel"], "within_sessions": by_session}


def _times(data: xr.Dataset) -> TimesRecord:
    samples, values = ([float(data[f"effective_{name}{end}"]) for end in _ENDS] for name in ("samples", "values"))
    lag1 = None
    if data.sizes["lag"] > 1:
        lag1 = [float(data[f"autocorrelation{end}"].isel(lag=1)) for end in _ENDS]
    return {
        "effective_samples": samples,
        "effective_values": values,
        "samples": data.sizes["lag"],
        "values": int(data["values"]) if "values" in data else None,
        "lag1": lag1,
        "p": {str(test): float(data["p"].sel(test=test)) for test in data["test"].values},
        "reason": str(data["reason"].values),
    }


def _checks(tree: xr.DataTree) -> list[dict[str, Any]]:
    data = summarise_checks(tree)
    return [
        {"statistic": str(name), **{str(key): one[key].item() for key in one.data_vars}}
        for name, one in ((name, data.sel(statistic=name)) for name in data["statistic"].values)
    ]


def _components(audit: Audit) -> ComponentsRecord:
    found = audit.components
    rows = [
        ComponentRow(
            quantity=str(quantity),
            component=str(component),
            **{
                str(name): float(found.summary[name].sel(quantity=quantity, component=component))
                for name in found.summary.data_vars
            },
        )
        for quantity in found.summary["quantity"].values
        for component in found.summary["component"].values
    ]
    effective = [
        {"n": int(n), **{str(name): float(found.effective[name].sel(n=n)) for name in found.effective.data_vars}}
        for n in found.effective["n"].values
    ]
    return {
        "sentences": list(found.sentences),
        "converged": found.converged,
        "standard_deviations": rows,
        "effective_taps": effective,
    }


def _after_taps(data: xr.Dataset) -> list[AfterTapsRow]:
    part = after_contacts(data)
    names = ("wrong", "doubt", "calibration_error", "log_loss", "brier", "factor")
    return [
        AfterTapsRow(
            taps=int(n),
            **{
                str(what): {
                    name: [plain(float(part[name + end].sel(contacts=n, what=what))) for end in _ENDS] for name in names
                }
                for what in part["what"].values
            },
        )
        for n in part["contacts"].values
    ]


def _scored(score: Scored, audit: Audit) -> RemedyRow:
    remedy = next(remedy for remedy in audit.remedies if remedy.name == score.name)
    n = audit.measured.n
    return RemedyRow(
        **score._asdict(),
        unbounded=_unbounded(score.factor),
        gain_per_tap=None if score.gain is None else [value / n for value in score.gain],
        title=remedy.title,
        assumes=remedy.assumes,
        how=remedy.how,
        power=remedy.model.exponent,
        saturation=remedy.setting.fit.saturation,
        right_model=None if remedy.beside is None else _tuned(remedy.beside),
    )


def _tuned(tuned: Tuned) -> TunedRecord:
    """What was tuned beside what a right model gives; a saturation of `MOST_TAPS` is none."""
    limit = tuned.saturation
    return {
        "sentence": tuned.sentence,
        "taps": tuned.taps,
        "simulations": tuned.simulations,
        "power": _outside(tuned.power),
        "saturation": None if limit is None else _outside(limit),
    }


def _outside(beside: Beside) -> OutsideRecord:
    return OutsideRecord(**beside._asdict(), outside=outside(beside))


def _clean(value: Any) -> Any:
    """The same without NaN, infinities and NumPy's numbers, which JSON does not take."""
    if isinstance(value, Mapping):
        return {str(key): _clean(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_clean(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return plain(value) if isinstance(value, float) else value
