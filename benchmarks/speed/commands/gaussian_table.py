"""Prints the seconds and processor seconds of the first table of likelihoods of a process.

`python gaussian_table.py MODEL TRAIN TEST` runs in any installation.
"""

import json
import sys
import time


def main(name: str, train: str, test: str) -> None:
    """Fits a model and measures the table."""
    import solidtouch as st  # noqa: PLC0415 - of the Python that runs this file

    model = st.fit(st.TapSet.load(train), model=name)
    taps = st.TapSet.load(test).taps
    began, used = time.perf_counter(), time.process_time()
    table(model, taps)
    print(json.dumps({"seconds": time.perf_counter() - began, "processor_s": time.process_time() - used}))


def table(model, taps) -> None:
    """Computes it; a name of its own, by which samples of the stack are found."""
    model.log_likelihood(taps)


if __name__ == "__main__":
    main(*sys.argv[1:])
