"""What each reference posterior is of, in words and equations; `x` are the taps, c the class of a tap."""

from typing import Any

_CELLS = "variance[c,j,k] ~ InverseGamma(2, 2); level[c,j,k] ~ Normal(0, sqrt(variance[c,j,k] / 0.01))"

WORDING: dict[str, dict[str, Any]] = {
    "histogram": {
        "model": [
            "p[c,k,.] ~ Dirichlet(1, ..., 1)",
            "density of x[n,j,k] = p[c,k,b] / (edges[b+1] - edges[b]) in bin b; end bins go on beyond the edges",
        ],
        "parameters": {"p": "[L,M,K,B]"},
        "how": "closed form: Dirichlet",
    },
    "gaussian": {
        "model": [_CELLS.replace("c,j,k", "c,k"), "x[n,j,k] ~ Normal(level[c,k], sqrt(variance[c,k]))"],
        "parameters": {"level": "[L,M,K]", "variance": "[L,M,K]"},
        "how": "closed form: normal-inverse-gamma",
    },
    "student": {
        "model": [
            "freedom[k] ~ Gamma(2, rate 0.1); spread[k] ~ HalfCauchy(5); typical[k] ~ Normal(0, 2); "
            "variety[k] ~ HalfNormal(1)",
            "level[c,k] ~ Normal(0, spread[k]); scale[c,k] ~ LogNormal(typical[k], variety[k])",
            "x[n,j,k] ~ StudentT(freedom[k], level[c,k], scale[c,k])",
        ],
        "parameters": dict.fromkeys(("freedom", "spread", "typical", "variety"), "[K]")
        | {"level": "[L,M,K]", "scale": "[L,M,K]"},
        "how": "",
    },
    "profile": {
        "model": [_CELLS, "x[n,j,k] ~ Normal(level[c,j,k], sqrt(variance[c,j,k]))"],
        "parameters": {"level": "[L,M,J,K]", "variance": "[L,M,J,K]"},
        "how": "closed form: normal-inverse-gamma",
    },
    "profile-ar": {
        "model": [
            f"rho[k] ~ Uniform(-1, 1); {_CELLS}",
            "x[n,j,k] ~ Normal(level[c,j,k] + rho[k] x[n,j-1,k], sqrt(variance[c,j,k])), with x[n,0,k] = 0",
        ],
        "parameters": {"rho": "[K]", "level": "[L,M,J,K]", "variance": "[L,M,J,K]"},
        "how": "closed form given rho, which is integrated over 101 points",
    },
    "profile-mvn": {
        "model": [
            f"slope[c,i] ~ Normal(0, 1/2) for each pair i of taxels k' < k; {_CELLS}",
            "x[n,j,k] ~ Normal(level[c,j,k] + sum over k' < k of slope[c,(k',k)] x[n,j,k'], sqrt(variance[c,j,k]))",
        ],
        "parameters": {"slope": "[L,M,K(K-1)/2]", "level": "[L,M,J,K]", "variance": "[L,M,J,K]"},
        "how": "",
    },
    "matrix-normal": {
        "model": [
            "time ~ Wishart(J + 2, I / (J + 2)), a precision [J,J]; taxel[c] ~ Wishart(K + 2, I / (K + 2)), [K,K]",
            "level[c] ~ MatrixNormal(0, inverse(time) / 0.01, inverse(taxel[c]))",
            "x[n] ~ MatrixNormal(level[c], inverse(time), inverse(taxel[c])): the covariance of samples (j,k) and "
            "(j',k') is inverse(time)[j,j'] inverse(taxel[c])[k,k']",
        ],
        "parameters": {"time": "[J,J]", "taxel": "[L,M,K,K]", "level": "[L,M,J,K]"},
        "how": "",
    },
    "smooth": {
        "model": [
            "weight[d,m,j,k] ~ Normal(0, width[d]); variance[l,m,j,k] ~ InverseGamma(2, 2)",
            "x[n,j,k] ~ Normal(sum over d of basis[l,d] weight[d,m,j,k], sqrt(variance[l,m,j,k]))",
        ],
        "parameters": {"weight": "[D,M,J,K]", "variance": "[L,M,J,K]"},
        "how": "",
    },
    "session": {
        "model": [
            "where ~ uniform over L, what ~ uniform over M, state ~ Categorical(exp(log_prior)), one for all taps",
            "P(x[n,j,k] in bin b) = Phi((u - level) / deviation) - Phi((v - level) / deviation), with "
            "u = (edges[b+1] - offset) / gain, v = (edges[b] - offset) / gain, level and deviation of "
            "[where,what,j,k], gain and offset of the state; end bins are open",
        ],
        "parameters": {"where": "", "what": "", "state": ""},
        "how": "enumerated",
    },
}
