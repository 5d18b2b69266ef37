"""Symbols of taps: the channel is that of the taps played on, and keeps what it can of what they tell."""

import numpy as np
import pytest
from solidtouch.inference.trials.symbols import quantised
from solidtouch.models.errors import InputError

L, M = 3, 2


@pytest.fixture(scope="module")
def model(make_model):
    return make_model(L, M, 2, 2, 6, taps=30, power="none", pseudocount=0.5)


def test_the_channel_is_how_often_each_class_gives_each_symbol_in_the_table(model):
    """So trials that draw from the table draw from the channel."""
    symbols = quantised(model, 5, 1, 300)
    pool, log_channel = symbols.table.pool, np.log(np.maximum(symbols.channel, 1e-300))

    assert symbols.channel.shape == (L, M, 5)
    for l in range(L):
        for m in range(M):
            own = pool.taps(l, m)
            of_taps = np.maximum(symbols.table.log_likelihood[own], np.log(1e-300))
            symbol = [np.abs(log_channel - row[:, :, None]).sum(axis=(0, 1)).argmin() for row in of_taps]
            assert len(own) == 300
            np.testing.assert_allclose(np.bincount(symbol, minlength=5) / 300, symbols.channel[l, m])
            rows = symbols.table.log_likelihood[own][np.arange(300), l, m]
            np.testing.assert_allclose(rows, np.log(symbols.channel[l, m][symbol]))


def test_more_symbols_keep_more_and_all_of_them_all(model):
    """One symbol keeps nothing."""
    kept = [quantised(model, S, 1, 300).kept for S in (1, 2, 4, 8, 16, 64)]

    assert kept[0] == pytest.approx(0, abs=1e-12)
    assert (np.diff(kept) > 0).all()
    assert kept[-1] > 0.95


def test_taps_of_few_kinds_need_no_more_symbols_than_kinds(make_model):
    """Two bins, one sample: two symbols, whose channel is close to the tables."""
    model = make_model(L, M, 1, 1, 2, taps=30, power="none", pseudocount=0.5)
    symbols = quantised(model, 9, 0, 4000)
    tables = model.probabilities[:, :, 0]

    assert symbols.channel.shape == (L, M, 2)
    order = np.argsort(symbols.channel[0, 0]), np.argsort(tables[0, 0])
    np.testing.assert_allclose(symbols.channel[..., order[0]], tables[..., order[1]], atol=0.04)


def test_of_several_starts_the_one_is_taken_that_keeps_most(model):
    kept = [quantised(model, 4, 2, 200, starts).kept for starts in (1, 3, 9)]

    assert (np.diff(kept) >= 0).all()
    assert kept[-1] > kept[0]


def test_a_seed_gives_the_same_symbols_again(model):
    first, again, other = (quantised(model, 4, seed, 100).channel for seed in (3, 3, 4))

    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_what_makes_no_sense_is_refused(model, make_model):
    with pytest.raises(InputError, match="symbols and starts must be at least 1, got 0 and"):
        quantised(model, 0, 0)
    with pytest.raises(InputError, match="taps_per_class must be at least 1, got 0"):
        quantised(model, 3, 0, 0)
    with pytest.raises(InputError, match="training taps in all classes"):
        quantised(make_model(L, M, untrained=[(1, 1)]), 3, 0)
