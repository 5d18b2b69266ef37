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


def test_lines_say_how_long_is_left(capsys, monkeypatch):
    """At the pace so far: in seconds up to two minutes, and not at the end."""
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    with progress.bars() as stage:
        advance = stage("Leaving out", 10)
        for clock[0], done in ((40.0, 1), (80.0, 1), (360.0, 1), (400.0, 7)):
            advance(done)
    told = capsys.readouterr().err

    assert [line for line in told.splitlines() if line.startswith("Leaving out:")] == [
        "Leaving out: 1 of 10, about 6 min left",
        "Leaving out: 2 of 10, about 5 min left",
        "Leaving out: 3 of 10, about 14 min left",
        "Leaving out: 10 of 10",
    ]
