"""Files of the reference posteriors, made by `benchmarks.posteriors.make`.

For each model `NAME.data.json`, `NAME.json` with moments and `NAME.csv.gz` with draws; `SHA256SUMS` has checksums.
"""
