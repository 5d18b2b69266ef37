"""Makes the reference posteriors in `analysis/posteriors/data`: data, moments, diagnostics and draws of each model.

    python -m benchmarks.posteriors.make [NAME...] --document docs/reference/posteriors/README.md

Moments are exact where they have a closed form; otherwise they come from ten chains of NUTS of 10,000 steps after 2,000
of adaptation, of which every tenth is kept; they must meet the criteria of posteriordb (Magnusson et al.,
arXiv:2407.04967). Draws in the folder are 100 of each of ten chains; exact ones are independent.
"""

import csv
import gzip
import io
import json
from argparse import ArgumentParser
from collections.abc import Iterable, Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import arviz as az
import jax
import numpy as np
import xarray as xr
from numpy.typing import NDArray
from numpyro.infer import MCMC, NUTS
from solidtouch.analysis.posteriors.quantities import flattened, on_scale
from solidtouch.models.seeds import Purpose, derived_seed, generator
from solidtouch.models.storage import complete_file

from benchmarks.page import check_block, table, write_block
from benchmarks.posteriors.targets import SEED, Moments, Target, taps, targets
from benchmarks.posteriors.wording import WORDING
from benchmarks.study import until_interrupted

FOLDER = Path("analysis/posteriors/data")
CHAINS, WARM_UP, STEPS, THIN = 10, 2_000, 10_000, 10
KEPT, STORED = STEPS // THIN, 100  # draws of each chain, for moments and in files
CRITERIA = {"r_hat": 1.01, "lag_1": 0.05, "e_fmi": 0.2}
"""Of posteriordb: largest R-hat and autocorrelation of kept draws, least energy fraction of missing information."""

type Draws = dict[str, NDArray[np.float64]]
"""Numbers by name, shape (chain, draw)."""


def made(target: Target) -> None:
    """Writes the files of one reference posterior.

    Raises:
        ValueError: Its chains do not meet the criteria.
    """
    number = [one.name for one in targets()].index(target.name)
    if target.moments is None:
        draws, diagnostics = _chains(target)
        summary = _estimated(draws, target.scales)
        kept = {name: values[:, :: values.shape[1] // STORED] for name, values in draws.items()}
    else:
        draws, diagnostics = _independent(target, number), None
        summary = _known(target.moments, target.scales, draws)
        kept = {name: values[:, :STORED] for name, values in draws.items()}
    how = {"method": "exact" if diagnostics is None else "nuts", "diagnostics": diagnostics}
    about = {"format": 1, "name": target.name, "license": "CC0-1.0", **WORDING[target.name], **how, "summary": summary}
    about["versions"] = {name: version(name) for name in ("numpy", "numpyro", "jax")}
    data = {**_data_of_taps(), **target.data} if target.story is not None else _counted(target.data)
    _write(f"{target.name}.data.json", _json(data).encode())
    _write(f"{target.name}.json", _json(about).encode())
    _write(f"{target.name}.csv.gz", _csv(kept))


def _data_of_taps() -> dict[str, Any]:
    known = taps()
    (L, M), (N, J, K) = known.shape, known.samples.shape
    sizes = {"L": L, "M": M, "J": J, "K": K, "N": N}
    return {**sizes, "where": known.where + 1, "what": known.what + 1, "taps": known.samples}


def _counted(data: Mapping[str, Any]) -> dict[str, Any]:
    """Data with the sizes of its arrays."""
    (L, M, J, K), S = data["level"].shape, len(data["gain"])
    return {"L": L, "M": M, "J": J, "K": K, "S": S, "N": len(data["taps"]), "B": len(data["edges"]) - 1, **data}


# Draws -------------------------------------------------------------------------------------------------------------


def _independent(target: Target, number: int) -> Draws:
    """Draws from an exact posterior."""
    rng = generator(SEED, Purpose.STUDY, 2, number)
    each = [target.exact.draw(rng) for _ in range(CHAINS * KEPT)]  # pyright: ignore[reportOptionalMemberAccess]
    names = target.scales
    sites = {name: np.stack([one[name] for one in each]) for name in names}
    return numbers({n: v.reshape(CHAINS, KEPT, *v.shape[1:]) for n, v in sites.items()}, target.scales)


def _chains(target: Target) -> tuple[Draws, dict[str, Any]]:
    """Kept draws of NUTS, and diagnostics."""
    with jax.enable_x64(True):
        kernel = NUTS(target.sampled or target.story, target_accept_prob=0.998 if target.sampled else 0.9)
        chains = MCMC(kernel, num_warmup=WARM_UP, num_samples=STEPS, num_chains=CHAINS, thinning=THIN,
                      chain_method="vectorized", progress_bar=False)  # fmt: skip
        chains.run(jax.random.key(derived_seed(SEED, Purpose.CHAINS)), extra_fields=("diverging", "energy"))
        sites = {name: np.asarray(v) for name, v in chains.get_samples(group_by_chain=True).items()}
        extra = {name: np.asarray(v) for name, v in chains.get_extra_fields(group_by_chain=True).items()}
    draws = numbers({name: sites[name] for name in target.scales}, target.scales)
    flat = xr.Dataset({name: (("chain", "draw"), values) for name, values in draws.items()})
    energy = extra["energy"]
    found = {
        "chains": CHAINS,
        "warm_up": WARM_UP,
        "steps": STEPS,
        "thinning": THIN,
        "r_hat": _worst(az.rhat(flat), max),
        "ess_bulk": _worst(az.ess(flat, method="bulk"), min),
        "ess_tail": _worst(az.ess(flat, method="tail"), min),
        "lag_1": max(abs(_lag_1(values)) for values in draws.values()),
        "e_fmi": float(((np.diff(energy, axis=1) ** 2).mean(axis=1) / energy.var(axis=1)).min()),
        "divergences": int(extra["diverging"].sum()),
    }
    fine = found["r_hat"] < CRITERIA["r_hat"] and found["lag_1"] < CRITERIA["lag_1"]
    if not (fine and found["e_fmi"] > CRITERIA["e_fmi"] and found["divergences"] == 0):
        raise ValueError(f"The chains of {target.name} do not meet the criteria {CRITERIA}: {found}")
    return draws, found


def _worst(found: xr.Dataset, pick: Any) -> float:
    return float(pick(float(values) for values in found.data_vars.values()))


def _lag_1(values: NDArray[np.float64]) -> float:
    """Mean autocorrelation over chains of neighbouring draws."""
    centred = values - values.mean(axis=1, keepdims=True)
    return float(((centred[:, 1:] * centred[:, :-1]).mean(axis=1) / (centred**2).mean(axis=1)).mean())


def numbers(sites: Mapping[str, NDArray[Any]], scales: Mapping[str, str]) -> Draws:
    """Every number of all parameters; of symmetric matrices those on and below the diagonal."""
    every = {}
    for name, values in sites.items():
        for one, each in flattened(name, values).items():
            *_, row, column = "0", *one.split(".")
            if scales[name] != "precision" or int(column) <= int(row):
                every[one] = each
    return every


# Moments -----------------------------------------------------------------------------------------------------------


def scale_of(name: str, scale: str) -> str:
    """The scale of one number of a parameter."""
    if scale == "precision":
        *_, row, column = name.split(".")
        return "log" if row == column else "identity"
    return scale or "identity"


def _known(moments: Mapping[str, Moments], scales: Mapping[str, str], draws: Draws) -> list[dict[str, Any]]:
    """Moments in closed form; of classes those that are neither rare nor nearly certain."""
    rows = []
    for name, (mean, variance) in moments.items():
        pairs = [flattened(name, np.broadcast_to(part, np.shape(mean))[None, None]) for part in (mean, variance)]
        for one in pairs[0]:
            m, v = (float(part[one][0, 0]) for part in pairs)
            if scales[name] != "classes":
                square = (on_scale(draws[one], scale := scale_of(one, scales[name])) - m) ** 2
                rows.append(_row(one, scale, m, 0.0, v, 0.0, float(square.std())))
            elif 0.05 <= m <= 0.95:
                rows.append(_row(name, f"is {one.split('.')[1]}", m, 0.0, v, 0.0, 0.0))
    return rows


def _estimated(draws: Draws, scales: Mapping[str, str]) -> list[dict[str, Any]]:
    """Moments of kept draws with their Monte Carlo standard errors."""
    rows = []
    for name, values in draws.items():
        scale = scale_of(name, scales[name.split(".")[0]])
        scaled = on_scale(values, scale)
        square = (scaled - scaled.mean()) ** 2
        errors = [float(az.mcse(part, method="mean")) for part in (scaled, square)]
        moments = float(scaled.mean()), errors[0], float(square.mean()), errors[1], float(square.std())
        rows.append(_row(name, scale, *moments))
    return rows


def _row(name: str, scale: str, *moments: float) -> dict[str, Any]:
    names = ("mean", "mcse_mean", "variance", "mcse_variance", "sd_square")
    return {"name": name, "scale": scale} | {
        key: float(f"{value:.10g}") for key, value in zip(names, moments, strict=True)
    }


# Files -------------------------------------------------------------------------------------------------------------


def _json(content: Mapping[str, Any]) -> str:
    """Keys of the first level on lines of their own, and rows of a summary, too."""

    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else value

    lines = []
    for key, value in content.items():
        text = json.dumps(value, default=plain, ensure_ascii=False)
        if key == "summary":
            text = "[\n  " + ",\n  ".join(json.dumps(row) for row in value) + "\n ]"
        lines.append(f" {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _csv(draws: Draws) -> bytes:
    """Draws of all chains, one after the other, with five digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["chain", *draws])
    columns = np.stack([*draws.values()], axis=-1)
    for chain, rows in enumerate(columns):
        writer.writerows([chain + 1, *(f"{x:.5g}" for x in row)] for row in rows)
    return gzip.compress(text.getvalue().encode(), mtime=0)


def _write(name: str, content: bytes) -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    with complete_file(FOLDER / name, force=True) as temporary:
        temporary.write_bytes(content)


def _checksums() -> None:
    files = sorted(
        path for path in FOLDER.iterdir() if path.suffix in {".gz", ".json", ".md"} or path.name == "LICENSE"
    )
    lines = [f"{sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    _write("SHA256SUMS", "".join(lines).encode())


def _table(names: Iterable[str]) -> str:
    rows = []
    for name in names:
        about = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
        found = about["diagnostics"]
        how = about["how"] if found is None else (
            f"{found['chains']} x {found['steps'] // found['thinning']} draws of NUTS, R-hat {found['r_hat']:.4f}, "
            f"ESS {found['ess_bulk']:.0f}, lag 1 {found['lag_1']:.3f}, E-FMI {found['e_fmi']:.2f}, "
            f"{found['divergences']} divergences"
        )  # fmt: skip
        rows.append([f"`{name}`", "<br>".join(about["model"]), str(len(about["summary"])), how])
    return table(["posterior", "model", "numbers compared", "moments"], rows)


def main() -> None:
    """Makes all reference posteriors, or those named."""
    every = {target.name: target for target in targets()}
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(every)}; default all")
    parser.add_argument("--document", type=Path, help="page to update")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in every]
    if unknown:
        parser.error(f"there is no reference posterior {unknown[0]!r}; choose from {', '.join(every)}")
    check_block(options.document, "posteriors")
    tasks = [lambda name=name: made(every[name]) for name in options.names or every]
    for _ in until_interrupted("Reference posteriors", tasks):
        _checksums()
    write_block(options.document, "posteriors", _table(every))


if __name__ == "__main__":
    main()
