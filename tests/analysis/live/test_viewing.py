"""`st.view`: what `perceive` returns as a page, and in a notebook."""

import sys
import webbrowser
from types import SimpleNamespace

import numpy as np
import pytest
from event_viewer import ask, viewer
from solidtouch.analysis.live import viewing
from solidtouch.analysis.live.saved import encoded_episodes, load_episodes, save_episodes, tap_record
from solidtouch.analysis.live.view import Seen

import solidtouch as st


@pytest.fixture(scope="module")
def made(make_taps, make_model):
    """A model, and a function that plays an episode of it with taps of another seed."""
    model = make_model(5, 3, 4, 6)

    def play(start=4, stop=1.0, move=None, run=st.perceive):
        recording = make_taps(5, 3, 6, 4, seed=7, preprocessing=model.preprocessing)
        rig = st.ReplayRig(recording, recording.grid(), start, 1)
        return run(rig, st.make_engine("numpy", model), stop, move or st.fixation(2), 6)

    return model, play


def test_an_episode_is_shown_as_its_steps_are(made):
    """Every number of every tap."""
    model, play = made
    shown = viewing.recorded_episodes([play()])
    steps = list(play(run=st.steps))

    wanted = [tap_record(1, Seen(step, model.grid, 1.0, 2, None, rule="another rule")) for step in steps]
    assert shown.taps == wanted
    assert (shown.header.fixation, shown.header.theta, shown.header.taxels) == (2, None, 4)
    assert (shown.ends[0].reason, shown.ends[0].taps) == ("deadline", 6)


def test_an_episode_keeps_its_samples_and_what_it_was_made_with(made):
    model, play = made
    episode = play(stop=0.5, move=st.passive())

    assert episode.samples.shape == (episode.taps, 6, 4)
    assert (episode.setup.theta, episode.setup.fixation, episode.setup.model) == (0.5, None, model)
    decided = viewing.recorded_episodes([episode])
    assert decided.ends[0].reason == ("threshold" if episode.stopped else "deadline")
    np.testing.assert_allclose(decided.taps[-1].belief, np.exp(episode.log_beliefs[-1]), atol=1e-9)


def test_a_rig_tells_where_its_taxels_are_and_their_unit():
    rig = st.SimulatedRig("paper", seed=4, session=1, position_mm=2.3, what=1)
    assert rig.taxel_mm.shape == (12, 3)
    assert rig.units == "counts"


def test_readings_have_the_unit_of_the_sensor(made):
    """If it tells one."""
    _, play = made
    episode = play()
    for units in ("", "kPa"):
        shown = viewing.recorded_episodes([episode._replace(setup=episode.setup._replace(units=units))])
        assert shown.header.reading_unit == units


def test_several_episodes_and_files_are_shown(made, tmp_path):
    _, play = made
    both = viewing.recorded_episodes([play(0), play(4)])
    save_episodes(encoded_episodes(both), tmp_path / "e.json")
    page = st.view(tmp_path / "e.json", browser=False)
    try:
        assert page.episodes == load_episodes(tmp_path / "e.json") == both
        with viewer(page.url) as read:
            assert len(read(1 + 12 + 2 + 1)) == 16
        assert repr(page) == f"<EpisodeView of 12 taps at {page.url}>"
        assert "createPlayer" in page._repr_html_()
    finally:
        page.close()
    with pytest.raises(OSError, match="refused"):
        ask(page.url)


def test_episodes_of_other_classes_or_of_steps_are_refused(made, make_model, make_taps):
    _, play = made
    other = make_model(3, 2, 4, 6)
    recording = make_taps(3, 2, 6, 4, preprocessing=other.preprocessing)
    rig = st.ReplayRig(recording, recording.grid(), 0, 1)
    smaller = st.perceive(rig, st.make_engine("numpy", other), 1.0, st.passive(), 2)
    with pytest.raises(st.InputError, match="episodes with the same classes and taxels"):
        st.view([play(), smaller])
    with pytest.raises(st.InputError, match="this one has no setup"):
        st.view(play()._replace(setup=None))


@pytest.fixture
def notebook(monkeypatch):
    """This program as the kernel of a notebook."""
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))


def test_a_notebook_gets_a_widget(made, request):
    """With the data of the file."""
    pytest.importorskip("anywidget", reason="anywidget is not installed")
    from solidtouch.analysis.live.widget import EpisodeWidget

    request.getfixturevalue("notebook")
    episode = made[1]()
    shown = st.view(episode)

    assert isinstance(shown, EpisodeWidget)
    assert shown.episodes == encoded_episodes(viewing.recorded_episodes([episode])).decode()


@pytest.mark.usefixtures("notebook")
def test_a_notebook_without_anywidget_is_told_what_to_install(made, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "solidtouch.analysis.live.widget", raising=False)
    with pytest.raises(st.InputError, match=r"needs anywidget: pip install 'solidtouch\[notebook\]'"):
        st.view(made[1]())


def test_without_a_display_the_address_is_printed(made, monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    page = st.view(made[1]())
    page.close()

    assert capsys.readouterr().err == f"Open {page.url} in a browser.\n"


def test_with_a_display_the_browser_is_waited_for(made, monkeypatch):
    """Only until it has the page."""
    waited = []
    monkeypatch.setattr(viewing, "open_page", lambda url: bool(waited.append(url)) or True)
    monkeypatch.setattr("solidtouch.analysis.live.server.PageServer.wait_until_served", lambda _, s: waited.append(s))
    page = st.view(made[1]())
    page.close()

    assert waited == [page.url, 20.0]


def test_without_a_browser_the_address_is_printed(made, monkeypatch, capsys):
    """A display alone does not open a page."""
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("webbrowser.get", raising(webbrowser.Error("could not locate runnable browser")))
    page = st.view(made[1]())
    page.close()

    assert capsys.readouterr().err == f"Open {page.url} in a browser.\n"


def raising(error):
    def get():
        raise error

    return get


def test_fragments_have_no_names_in_common(made):
    """The same episode is the same HTML; two of them on one page find their own data."""
    episodes = viewing.recorded_episodes([made[1]()])

    assert viewing.fragment(episodes) == viewing.fragment(episodes)
    assert " id=" not in viewing.fragment(episodes)
