"""Samples one of these models with PyMC and writes the draws as netCDF.

python sample_pymc.py smooth reference/smooth.data.json draws.nc
solidtouch conformance draws smooth draws.nc
"""

import json
import sys
from pathlib import Path

import numpy as np
import pymc as pm
import pytensor.tensor as pt

name, source, target = sys.argv[1:]
given = json.loads(Path(source).read_text())
data = {key: np.array(value) if isinstance(value, list) else value for key, value in given.items()}
x, where, what = data["taps"], data["where"] - 1, data["what"] - 1
of_class = data["L"], data["M"], data["J"], data["K"]

with pm.Model() as model:
    variance = pm.InverseGamma("variance", alpha=2, beta=2, shape=of_class)
    if name == "smooth":
        width = data["width"][:, None, None, None]
        weight = pm.Normal("weight", 0, width, shape=(len(width), *of_class[1:]))
        mean = pt.tensordot(data["basis"], weight, 1)[where, what]
    else:
        level = pm.Normal("level", 0, pt.sqrt(variance / 0.01), shape=of_class)
        mean = level[where, what]
    if name == "profile-ar":
        rho = pm.Uniform("rho", -1, 1, shape=data["K"])
        before = np.concatenate([np.zeros_like(x[:, :1]), x[:, :-1]], axis=1)
        mean += rho * before
    pm.Normal("x", mean, pt.sqrt(variance[where, what]), observed=x)
    chains = pm.sample(1000, tune=1000, chains=4, random_seed=24, target_accept=0.95, progressbar=False)
chains.to_netcdf(target)
