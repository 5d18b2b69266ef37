# Samples a Stan program with rstan and writes the draws as one CSV file; reads the data with jsonlite.
#
#     Rscript sample.R gaussian.stan gaussian.data.json draws.csv
#     solidtouch conformance draws gaussian draws.csv

words <- commandArgs(trailingOnly = TRUE)
library(rstan)
library(jsonlite)
if (!file.exists(rstan_options("boost_lib"))) rstan_options(boost_lib = "/usr/include") # as Debian has it
data <- fromJSON(words[2])
code <- readLines(words[1])
if (package_version(stan_version()) < "2.26") # which knows arrays as "real x[N]" only
  code <- gsub("array\\[([^]]*)\\] ([a-z]+(<[^>]*>)?) ([a-z_]+);", "\\2 \\4[\\1];", code)
fit <- stan(model_code = code, data = data, chains = 4, iter = 3000, warmup = 1000, refresh = 0, seed = 24,
            control = list(adapt_delta = 0.99))
each <- extract(fit, permuted = FALSE)
rows <- do.call(rbind, lapply(seq_len(dim(each)[2]), function(chain) cbind(chain, each[, chain, ])))
write.csv(rows, words[3], row.names = FALSE)
