// `gaussian`: normal samples for each class and taxel. Data: gaussian.data.json of the reference posteriors.
// Names end in an underscore where Stan reserves them.
data {
  int<lower=1> L;
  int<lower=1> M;
  int<lower=1> J;
  int<lower=1> K;
  int<lower=1> N;
  array[N] int<lower=1, upper=L> where;
  array[N] int<lower=1, upper=M> what;
  array[N, J, K] real taps;
}
parameters {
  array[L, M, K] real level;
  array[L, M, K] real<lower=0> variance_;
}
model {
  for (l in 1:L) {
    for (m in 1:M) {
      for (k in 1:K) {
        variance_[l, m, k] ~ inv_gamma(2, 2);
        level[l, m, k] ~ normal(0, sqrt(variance_[l, m, k] / 0.01));
      }
    }
  }
  for (n in 1:N) {
    for (j in 1:J) {
      for (k in 1:K) {
        taps[n, j, k] ~ normal(level[where[n], what[n], k], sqrt(variance_[where[n], what[n], k]));
      }
    }
  }
}
