// `student`: Student's t samples. Data: student.data.json of the reference posteriors.
// Logarithms of scales are sampled as standard normal deviations from what is typical, as they may vary by very little.
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
  vector<lower=0>[K] freedom;
  vector<lower=0>[K] spread;
  vector[K] typical;
  vector<lower=0>[K] variety;
  array[L, M, K] real level;
  array[L, M, K] real deviation;
}
transformed parameters {
  array[L, M, K] real<lower=0> scale;
  for (l in 1:L) {
    for (m in 1:M) {
      for (k in 1:K) {
        scale[l, m, k] = exp(typical[k] + variety[k] * deviation[l, m, k]);
      }
    }
  }
}
model {
  freedom ~ gamma(2, 0.1);
  spread ~ cauchy(0, 5);
  typical ~ normal(0, 2);
  variety ~ normal(0, 1);
  for (l in 1:L) {
    for (m in 1:M) {
      for (k in 1:K) {
        level[l, m, k] ~ normal(0, spread[k]);
        deviation[l, m, k] ~ normal(0, 1);
      }
    }
  }
  for (n in 1:N) {
    for (j in 1:J) {
      for (k in 1:K) {
        taps[n, j, k] ~ student_t(freedom[k], level[where[n], what[n], k], scale[where[n], what[n], k]);
      }
    }
  }
}
