"""The data format of episodes: what it holds, and what is refused."""

import json

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from solidtouch.analysis.live.saved import (
    encoded,
    encoded_episodes,
    header_of,
    load_episodes,
    save_episodes,
    significant,
)
from solidtouch.analysis.live.view import record, sentence
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.preprocessing import Preprocessing


def test_a_file_holds_what_was_saved(tmp_path, episodes):
    """Every number of it, one record in a line; an existing file stays."""
    path = tmp_path / "e.json"
    save_episodes(encoded_episodes(episodes), path)

    assert load_episodes(path) == episodes
    assert len(path.read_text().splitlines()) == 14 + 5
    with pytest.raises(InputError, match="already exists"):
        save_episodes(b"", path)
    assert load_episodes(path) == episodes


def test_a_record_of_a_tap_is_what_perceive_prints_and_what_is_needed_to_draw_it(seen_episodes, episodes):
    _, taps, _ = seen_episodes(names=["ball", episodes.header.what_name[1], "rod"])
    for own, seen in zip(episodes.taps, [seen for one in taps for seen in one], strict=True):
        content = json.loads(encoded(own))
        assert {"episode": own.episode, **record(seen)} == {key: content[key] for key in ("episode", *record(seen))}
        assert content["sentence"] == sentence(seen)
        np.testing.assert_allclose(content["belief"], np.exp(seen.step.log_belief), atol=1e-9)
        np.testing.assert_allclose(content["readings"], seen.step.tap, rtol=1e-6)
        np.testing.assert_allclose(np.sum(content["belief"], axis=0), content["what_marginal"], atol=1e-8)


@given(arrays(np.float64, 5, elements=st.floats(allow_nan=False, allow_infinity=False)), st.integers(1, 15))
def test_rounding_keeps_significant_digits(values, digits):
    """And takes no more characters for them than they need."""
    rounded = significant(values, digits)

    assert np.all(np.abs(rounded - values) <= 0.5000001 * 10.0 ** (1 - digits) * np.abs(values))
    usual = np.abs(values[(np.abs(values) > 1e-5) & (np.abs(values) < 1e5)])
    assert all(len(repr(value)) <= digits + 9 for value in significant(usual, digits).tolist())


def test_an_impossible_tap_has_no_evidence(seen_episodes):
    """JSON knows no infinity."""
    from solidtouch.analysis.live.saved import tap_record

    _, ((seen, *_), *_), _ = seen_episodes()
    impossible = seen._replace(step=seen.step._replace(log_evidence=-np.inf, no_class_left=True, move=None))

    assert tap_record(1, impossible).log_evidence is None
    assert b"null" in encoded(tap_record(1, impossible))


def changed(content, path, value):
    """The same JSON with another value; `...` removes it."""
    whole = json.loads(content)
    at = whole
    for key in path[:-1]:
        at = at[key]
    if value is ...:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return json.dumps(whole).encode()


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (["format"], "other", "format: must be solidtouch episodes, got 'other'"),
        (["version"], 2, "version: must be 1, got 2"),
        (["header"], ..., "missing key `header`"),
        (["taps"], [], "holds no tap"),
        (["taps", 3, "belief"], ..., r"taps\[3\]: missing key `belief`"),
        (["taps", 3, "p"], "small", r"taps\[3\]\.p: must be a number, got 'small'"),
        (["taps", 3, "belief", 0], [1.0], "tap 4 of episode 1: belief must be 4 rows of 3 numbers"),
        (["taps", 3, "readings"], [], "tap 4 of episode 1: readings must be 6 rows of 5 numbers"),
        (["taps", 3, "where_index"], 4, "tap 4 of episode 1: marginals and where_index do not fit"),
        (["taps", 3, "tap"], 9, "tap 9 of episode 1 follows tap 3 of episode 1"),
        (["taps", 0, "episode"], 0, r"episode: must be an integer from 1, got 0"),
        (["header", "samples"], 0, "header.samples: must be an integer from 1, got 0"),
        (["ends", 1], ..., None),
        (["ends", 0], ..., "ends must be numbered"),
        (["ends"], [], "there are 2 episodes, but 0 ends"),
        (["header", "fixation"], 4, "header.fixation must be a position index from 0 to 3, got 4"),
        (["header", "taxel_mm"], [[0, 0]], "header.taxel_mm must have 5 entries, got 1"),
        (["header", "where_label"], ["a"], "header.where_label must have 4 entries, got 1"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, episodes, path, value, said):
    """In one sentence that names the file and the place; an episode that was interrupted has no end."""
    file = tmp_path / "e.json"
    file.write_bytes(changed(encoded_episodes(episodes), path, value))
    if said is None:
        assert len(load_episodes(file).ends) == 1
        return
    with pytest.raises(InputError, match=said) as refused:
        load_episodes(file)
    assert str(refused.value).startswith(f"{file}: ")


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b'{"format": 1}', b"[" * 100_000])
def test_other_files_are_refused(tmp_path, content):
    file = tmp_path / "e.json"
    file.write_bytes(content)
    with pytest.raises(InputError, match="not a file of episodes from perceive --save-episode"):
        load_episodes(file)


@pytest.mark.parametrize("name", ["none.json", "."])
def test_a_file_that_cannot_be_read_is_named(tmp_path, name):
    with pytest.raises(InputError, match="cannot read: "):
        load_episodes(tmp_path / name)


def test_a_name_must_end_in_json(tmp_path):
    with pytest.raises(InputError, match=r"must end in \.json"):
        save_episodes(b"", tmp_path / "e.txt")


def header(taxel_mm, taxels=3):
    return header_of(
        "", ClassGrid([0.5], "mm", None, ["a"]), Preprocessing(samples=2), taxels, taxel_mm=taxel_mm
    ).taxel_mm


def test_places_of_taxels_lie_in_the_plane_in_which_they_differ():
    """Two coordinates stay; places that do not fit are none."""
    assert header([[0, 5, 1], [2, 5.5, 3], [4, 5, 6]]) == [(0, 1), (2, 3), (4, 6)]
    assert header([[0, 1], [2, 3], [4, 6]]) == [(0, 1), (2, 3), (4, 6)]
    assert header([[0, 1]]) is None
    assert header([[0], [1], [2]]) is None
    assert header([[0, 1], [2, np.nan], [4, 6]]) is None
    assert header(None) is None


def test_a_threshold_of_one_is_none():
    grid, record = ClassGrid([0.5], "mm", None, ["a"]), Preprocessing(samples=2)

    assert header_of("", grid, record, 1).theta is None
    assert msgspec.to_builtins(header_of("", grid, record, 1, theta=0.5))["theta"] == 0.5
