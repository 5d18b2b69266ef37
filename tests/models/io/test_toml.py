"""Settings files that would exhaust a parser end in one sentence, soon."""

import re
import time

import pytest
from solidtouch.analysis.sweep.study import load_study
from solidtouch.hardware.recording.plan import load_plan
from solidtouch.hardware.rig.settings import load_rig
from solidtouch.models.errors import InputError

LOADERS = {"rig": load_rig, "plan": load_plan, "study": load_study}
HOSTILE = {
    "nested arrays": ("x = " + "[" * 5_000 + "]" * 5_000, "nested too deeply"),
    "nested tables": ("x = " + "{a=" * 5_000 + "1" + "}" * 5_000, "nested too deeply"),
    "long integer": ("x = " + "9" * 5_000, "an integer is beyond 64 bits"),
    "long hexadecimal": ("x = 0x" + "f" * 60_000, "an integer is beyond 64 bits"),
    "long key": ("a = 1\n" + "a." * 20_000 + "a = 1", "line 2: a dotted key has more than 32 parts"),
    "long heading": ("[" + "a . " * 15_000 + "a]", "line 1: a dotted key has more than 32 parts"),
    "long quoted key": (r'"\"". ' * 10_000 + "a = 1", "line 1: a dotted key has more than 32 parts"),
    "mixed key": ("'=,'.\"[\".a." * 5_000 + "a = 1", "line 1: a dotted key has more than 32 parts"),
    "no key": ("a" * 65_000, "not TOML"),
    "quotes": ('"' * 65_000, "not TOML"),
    "unknown key": ("a" * 60_000 + " = 1", "unknown key `a{100,200}"),
    "too large": ("# " + "x" * 65_536, "larger than 64 KiB"),
}


@pytest.mark.parametrize("load", LOADERS.values(), ids=LOADERS)
@pytest.mark.parametrize(("text", "sentence"), HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_settings_file_is_refused_in_a_short_sentence(load, text, sentence, tmp_path):
    path = tmp_path / "settings.toml"
    path.write_text(text)

    start = time.perf_counter()
    with pytest.raises(InputError, match=sentence) as caught:
        load(path)

    assert time.perf_counter() - start < 1
    assert str(caught.value).startswith(f"{path}: ")
    assert len(str(caught.value)) < 400 + len(str(path))


def test_a_file_of_100_megabytes_is_not_read(tmp_path):
    path = tmp_path / "rig.toml"
    with path.open("wb") as file:
        file.truncate(10**8)

    with pytest.raises(InputError, match=re.escape(f"{path}: larger than 64 KiB")):
        load_rig(path)


def test_a_key_of_many_words_in_a_text_is_no_dotted_key(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(f'note = "{"One two. " * 100}"\nx = [{", ".join(["1.5"] * 1_000)}]\n')

    with pytest.raises(InputError, match="key"):
        load_rig(path)
    with pytest.raises(InputError) as caught:
        load_rig(path)
    assert "dotted" not in str(caught.value)
