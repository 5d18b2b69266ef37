"""A recording that would not fit is refused before it begins."""

from types import SimpleNamespace

import pytest
from solidtouch.hardware.recording import recording as disk_space
from solidtouch.hardware.recording.recording import check_space, space_needed
from solidtouch.models.errors import InputError


def test_space_is_asked_for_in_advance(fake_rig, tmp_path, monkeypatch):
    """Twice what a recording takes, in round figures."""
    needed = space_needed(1600, fake_rig.fake_settings())
    assert 1e7 < needed < 1e9
    monkeypatch.setattr(disk_space.shutil, "disk_usage", lambda _: SimpleNamespace(free=needed - 1))
    check_space(tmp_path / "a.mcap", needed - 1)

    with pytest.raises(InputError, match=r"a\.mcap: may need [\d.]+ MB, but only [\d.]+ MB are free"):
        check_space(tmp_path / "a.mcap", needed)


def test_space_cannot_be_asked_of_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="cannot write: No such file"):
        check_space(tmp_path / "no" / "a.mcap", 1)
