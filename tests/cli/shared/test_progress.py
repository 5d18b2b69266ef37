"""Progress of long stages where there is no terminal."""

from solidtouch.cli.shared import progress


def test_long_stages_say_a_line_now_and_then(capsys, monkeypatch):
    """And nothing more often than that, until the bars at the end."""
    monkeypatch.setattr(progress, "LINE_S", 0.0)
    with progress.bars() as stage:
        advance = stage("Playing [red]", 3)
        advance(1)
        advance(2)
    told = capsys.readouterr().err
    assert "Playing [red]: 1 of 3\nPlaying [red]: 3 of 3\n" in told

    monkeypatch.setattr(progress, "LINE_S", 30.0)
    with progress.bars() as stage:
        stage("Playing", 3)(2)
    assert " of 3" not in capsys.readouterr().err
