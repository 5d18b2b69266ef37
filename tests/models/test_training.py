"""Test taps that trained the model: which they are, and what is said of them."""

import numpy as np
import pytest
from solidtouch.models.blocks import tap_digests
from solidtouch.models.errors import InputError
from solidtouch.models.splits import Fold, Split, split, two_files, untrained
from solidtouch.models.taps import TapSet, concatenate
from solidtouch.models.training import training_taps, without_training


def digests(*parts):
    return tap_digests(np.concatenate([part.taps for part in parts]))


def binned(taps, values, generator):
    """The same labels with samples of a few values, so that most taps equal others."""
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"] = dataset["taps"].copy(data=generator.integers(values, size=taps.taps.shape))
    return TapSet(dataset)


def test_a_session_that_trained_is_left_out_and_the_other_stays(make_taps):
    """As they stand in one file."""
    taps = make_taps(sessions=2)
    rest, sentence = without_training(taps, digests(taps.select(taps.session == 0)))

    np.testing.assert_array_equal(rest.taps, taps.select(taps.session == 1).taps)
    assert sentence.startswith(
        "all 84 taps of session 0 trained the model and are left out; --training-taps keeps them"
    )


def test_of_a_session_of_which_single_taps_trained_the_others_stay(make_taps):
    """Also half of it, as of one that was split; beyond two thirds none."""
    taps = make_taps(sessions=1, repeats=10)
    for trained, left in ((3, 117), (60, 60), (80, 40), (81, 0)):
        known = training_taps(taps, digests(taps.select(np.arange(120) < trained)))
        assert (~known).sum() == left
    assert without_training(taps, digests(taps.select(np.arange(120) < 3)))[1].startswith("3 of 120 taps of session 0")


def test_all_sessions_concerned_are_named(make_taps):
    """With how many of their taps."""
    taps = make_taps(sessions=4)
    some = (taps.session == 0) | ((taps.session == 2) & (np.arange(len(taps)) % 2 == 0)) | (np.arange(len(taps)) == 335)
    rest, sentence = without_training(taps, digests(taps.select(some)))

    assert len(rest) == (~some).sum()
    assert sentence.startswith("all 84 taps of session 0, 42 of 84 taps of session 2 and 1 of 84 taps of session 3")


def test_nothing_is_said_where_no_tap_trained(make_taps):
    """Nor where a model does not name its taps."""
    taps = make_taps(seed=1)
    for training in (digests(make_taps(seed=2)), np.empty(0, np.uint64)):
        rest, sentence = without_training(taps, training)
        assert (rest, sentence) == (taps, "")


def test_taps_that_all_trained_are_refused_or_kept_with_a_sentence(make_taps):
    """The sentence names the option."""
    taps = make_taps(sessions=2)
    with pytest.raises(InputError, match=r"^No tap left to test: all 84 .*session 1 trained.* with --training-taps"):
        without_training(taps, digests(taps))
    rest, sentence = without_training(taps, digests(taps), keep=True)
    assert rest is taps
    assert sentence.endswith("are kept, so expect larger errors on new taps.")


@pytest.mark.parametrize("values", [2, 3, 12])
def test_binned_taps_that_are_equal_by_chance_stay(make_taps, values):
    """Of one sample and taxel, or two, few values make most taps equal to training taps."""
    generator = np.random.default_rng(values)
    train, test = (binned(make_taps(J=1, K=2, repeats=20), values, generator) for _ in range(2))

    assert np.isin(digests(test), digests(train)).mean() > 0.5
    assert not training_taps(test, digests(train)).any()


def test_a_training_session_is_found_among_taps_that_repeat(make_taps):
    """As where some positions have no contact, so that their taps are alike."""
    taps = make_taps(sessions=2)
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"] = dataset["taps"].copy(data=taps.taps * (np.arange(len(taps)) % 5 > 0)[:, None, None])
    taps = TapSet(dataset)
    known = training_taps(taps, digests(taps.select(taps.session == 1)))

    np.testing.assert_array_equal(known, taps.session == 1)


def test_each_fold_is_judged_by_its_own_training_taps(make_taps):
    """A file of three sessions, two of which are the same."""
    taps = make_taps(sessions=2)
    copy = taps.select(taps.session == 1)
    again = TapSet(copy.dataset.assign_coords(session=("tap", copy.session + 1)))
    three = concatenate([taps, again])
    fold = untrained(split(three, three.grid(), train_sessions=[0, 1], test_sessions=[2]), keep=True)

    assert "all 84 taps of session 2 trained the model and are kept" in fold.warning
    with pytest.raises(InputError, match="all 84 taps of session 1 trained"):
        untrained(split(three, three.grid(), "leave-one-session-out"))
    left = Fold(taps, concatenate([again, make_taps(seed=5, sessions=1)]), "both")
    parts = untrained(Split((left, Fold(taps, make_taps(seed=6), "other")), "files", "Two folds."))
    assert [len(fold.test) for fold in parts.folds] == [84, 168]
    assert parts.warning.startswith("Both: all 84 taps of session 2 trained")


def test_two_files_that_share_nothing_are_as_they_were(make_taps):
    """With no word about it."""
    parts = untrained(two_files(make_taps(seed=1), make_taps(seed=2)))

    assert (len(parts.folds[0].test), parts.warning) == (168, "")
