"""Maps to begin with of folders that hold more than recordings: tables of labels and events, other files."""

import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.first_look.look import look
from solidtouch.models.io.layouts.mapping import TapMap, load_map
from solidtouch.models.io.layouts.tap_set import load_mapped

TAPS = np.random.default_rng(5).normal(size=(12, 20, 4)).round(3)
OBJECTS = np.random.default_rng(6).permutation(np.tile(["cup", "rod"], 6))


def converted(folder):
    """The text, the map that it is, taps in the order of the truth, and their objects."""
    text = look([folder], TapMap())
    (folder.parent / "map.toml").write_text(text)
    how = load_map(folder.parent / "map.toml")
    taps, _ = load_mapped([folder], how)
    samples, named = np.asarray(taps.samples), np.asarray(taps.what_name)[np.asarray(taps.what)]
    order = [int(np.abs(samples - tap[None]).max((1, 2)).argmin()) for tap in TAPS]
    np.testing.assert_allclose(samples[order], TAPS, atol=1e-6)
    return text, how, taps, named[order].tolist()


def table(path, header, rows):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")


@pytest.mark.parametrize("named", [False, True])
def test_labels_of_a_table_beside_recordings(named, tmp_path):
    folder = tmp_path / "in"
    for n, tap in enumerate(TAPS):
        table(folder / f"rec{n + 1}.csv", "s0,s1,s2,s3", tap)
    rows = [(f"rec{n + 1}.csv", name) if named else (name,) for n, name in enumerate(OBJECTS)]
    table(folder / "labels.csv", "file,label" if named else "label", rows)
    text, how, _, found = converted(folder)

    assert (how.files, how.tap, how.what) == ("rec{trial}.csv", "file", "labels.csv:label")
    assert found == OBJECTS.tolist()
    assert "# labels.csv: another layout (" in text
    assert "labels.csv is read " in text


def test_a_table_of_presses_cuts_and_labels_the_stream_beside_it(tmp_path):
    folder, quiet = tmp_path / "in", np.zeros((9, 4))
    rows = np.concatenate([part for tap in TAPS for part in (quiet, tap)] + [quiet])
    table(folder / "tactile.csv", "time,s0,s1,s2,s3", [(f"{n / 100:.2f}", *row) for n, row in enumerate(rows)])
    presses = [(f"{(29 * n + 9) / 100:.2f}", 0.2, name) for n, name in enumerate(OBJECTS)]
    table(folder / "events.csv", "onset,duration,object", presses)
    _, how, _, found = converted(folder)

    assert (how.files, how.trigger, how.events, how.window) == ("tactile.csv", "events", "events.csv:onset", 20)
    assert found == OBJECTS.tolist()


def test_presses_without_a_duration_are_proposed_with_what_is_missing(tmp_path):
    table(tmp_path / "in/stream.csv", "time,s0,s1", [(n / 10, n % 3, 1) for n in range(90)])
    table(tmp_path / "in/presses.csv", "onset,object", [(1.0, "cup"), (4.0, "rod")])
    text = look([tmp_path / "in"], TapMap())

    assert '# Perhaps: events = "presses.csv:onset"' in text
    assert "# With these lines: trigger (--trigger) events requires window (--window)" in text


@pytest.mark.parametrize("kind", ["csv", "npy"])
def test_parts_with_labels_in_files_called_alike(kind, tmp_path):
    folder, halves = tmp_path / "in", {"train": slice(0, 8), "test": slice(8, 12)}
    folder.mkdir()
    for part, which in halves.items():
        if kind == "npy":
            np.save(folder / f"X_{part}.npy", TAPS[which])
            np.save(folder / f"y_{part}.npy", OBJECTS[which])
            continue
        rows = [(i, j, *row) for i, tap in enumerate(TAPS[which]) for j, row in enumerate(tap)]
        table(folder / f"X_{part}.csv", "series_id,number,pressure_0,pressure_1,pressure_2,pressure_3", rows)
        table(
            folder / f"y_{part}.csv", "series_id,group,surface", [(i, 7, name) for i, name in enumerate(OBJECTS[which])]
        )
    text, how, taps, found = converted(folder)

    assert how.files == f"X_{{session}}.{kind}"
    assert how.what == ("y_{session}.csv:surface" if kind == "csv" else "y_{session}.npy")
    assert "test, train, which are numbered in this order" in text
    assert (found, len(set(taps.session.tolist()))) == (OBJECTS.tolist(), 2)


def test_a_table_for_each_stream_lists_its_presses_in_order(tmp_path):
    quiet = np.zeros((9, 4))
    for s in (1, 2):
        some = TAPS[6 * (s - 1) : 6 * s]
        rows = [(*row, down) for tap in some for part, down in ((quiet, 0), (tap, 1)) for row in part]
        table(tmp_path / f"in/stream_session{s}.csv", "s0,s1,s2,s3,contact", [*rows, (0, 0, 0, 0, 0)])
        presses = [(n + 1, name) for n, name in enumerate(OBJECTS[6 * (s - 1) : 6 * s])]
        table(tmp_path / f"in/trials_session{s}.csv", "press,object", presses)
    _, how, taps, found = converted(tmp_path / "in")

    assert (how.signal, how.window, how.what) == ("contact", 20, "trials_{session}.csv:object")
    assert (found, len(set(taps.session.tolist()))) == (OBJECTS.tolist(), 2)


def test_labels_of_a_table_are_told_where_names_of_files_have_some(tmp_path):
    for n, tap in enumerate(TAPS):
        table(tmp_path / f"in/{OBJECTS[n]}_{n}.csv", "s0,s1,s2,s3", tap)
    table(
        tmp_path / "in/index.csv", "file,material", [(f"{name}_{n}.csv", "ab"[n % 2]) for n, name in enumerate(OBJECTS)]
    )
    text = look([tmp_path / "in"], TapMap())

    assert 'files = "{what}_{trial}.csv"' in text
    assert '# Perhaps: what = "index.csv:material" (a table beside, rather than names)' in text


def test_one_of_several_tables_of_labels_is_proposed(tmp_path):
    for n, tap in enumerate(TAPS):
        table(tmp_path / f"in/rec{n}.csv", "s0,s1,s2,s3", tap)
    for name in ("labels.csv", "labels_old.csv"):
        table(tmp_path / f"in/{name}", "file,object", [(f"rec{n}.csv", each) for n, each in enumerate(OBJECTS)])

    assert '# Perhaps: what = "labels.csv:object" (one of 2 tables)' in look([tmp_path / "in"], TapMap())


def test_names_of_numbered_objects_in_a_table(tmp_path):
    rows = [(n, 1 + (OBJECTS[n] == "rod"), *row) for n, tap in enumerate(TAPS) for row in tap]
    table(tmp_path / "in/session1.csv", "tap,material_id,s0,s1,s2,s3", rows)
    table(tmp_path / "in/materials.csv", "id,name", [(1, "cup"), (2, "rod")])
    _, how, _, found = converted(tmp_path / "in")

    assert (how.files, how.what_names, how.one_based) == ("session1.csv", "materials.csv:name", True)
    assert found == OBJECTS.tolist()


def test_files_of_another_layout_do_not_match_the_pattern(tmp_path):
    for n in (1, 2):
        table(tmp_path / f"in/session{n}.csv", "tap,s0,s1", [(k // 5, k, n) for k in range(40)])
    table(tmp_path / "in/notes.csv", "key,value", [("hardness", 40)])

    assert 'files = "session{session}.csv"  # 2 files\n' in look([tmp_path / "in"], TapMap())


def test_endings_may_have_capitals(tmp_path):
    for n, tap in enumerate(TAPS):
        table(tmp_path / f"in/{OBJECTS[n]}/PRESS{n}.CSV", "s0,s1,s2,s3", tap)

    assert converted(tmp_path / "in")[3] == OBJECTS.tolist()


def test_tables_below_other_lines_with_any_ending(tmp_path):
    before = "LabVIEW Measurement\t\nDate\t2018/04/11\nChannels\t4\t\t\t\t\n***End_of_Header***\t\n"
    (tmp_path / "in").mkdir()
    for n, tap in enumerate(TAPS):
        lines = ["X_Value\tV0\tV1\tV2\tV3", *("\t".join(map(str, (j / 100, *row))) for j, row in enumerate(tap))]
        (tmp_path / f"in/{OBJECTS[n]}_{n}.lvm").write_text(before + "\n".join(lines) + "\n")
    _, how, taps, found = converted(tmp_path / "in")

    assert (how.format, how.skip_rows, how.time, how.where, how.taxels) == ("text", 4, "X_Value", None, "V*")
    assert found == OBJECTS.tolist()
    assert taps.preprocessing.rate_hz == pytest.approx(100.0)


def test_comments_before_numbers(tmp_path):
    (tmp_path / "in").mkdir()
    for n, tap in enumerate(TAPS):
        text = "\n".join(" ".join(map(str, row)) for row in tap)
        (tmp_path / f"in/{OBJECTS[n]}_{n}.txt").write_text(f"# recorded on a day\n# taxels 1 to 4\n{text}\n")
    _, how, _, found = converted(tmp_path / "in")

    assert (how.comment, how.header, found) == ("#", False, OBJECTS.tolist())


def test_a_broken_file_is_told_and_others_are_shown(tmp_path):
    for n, tap in enumerate(TAPS):
        table(tmp_path / f"in/{OBJECTS[n]}_{n:02d}.csv", "s0,s1,s2,s3", tap)
    first = sorted((tmp_path / "in").iterdir())[0]
    first.write_text(first.read_text()[:-30].rpartition(",")[0] + "\n")
    text = look([tmp_path / "in"], TapMap())

    assert f"# {first}: " in text
    assert 'taxels = "s*"' in text
    assert f"# With this map: {first}: none of " in text


def test_texts_beside_a_recording_label_nothing(tmp_path):
    for n, tap in enumerate(TAPS):
        table(tmp_path / f"in/{n}.csv", "s0,s1,s2,s3", tap)
    (tmp_path / "in/README.txt").write_text("Tactile data, 2 materials\n12 presses each, 100 Hz\n")
    text = look([tmp_path / "in"], TapMap())

    assert "# README.txt: another layout" in text
    assert "what = " not in text


def test_columns_of_one_name_are_told(tmp_path):
    table(tmp_path / "in/r.csv", "tap,Force,Force,s0,s1", [(n // 5, n, n, n % 3, 1) for n in range(20)])
    text = look([tmp_path], TapMap())

    assert "Force.0  " in text
    assert "Force.1  " in text


def test_refusals(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked/a.csv").symlink_to(tmp_path / "gone.csv")
    for name, why in (("nothere", "no such file"), ("empty", "no file"), ("linked", "cannot read")):
        with pytest.raises(InputError, match=rf"{name}.*{why}"):
            look([tmp_path / name], TapMap())


def test_numbers_may_be_names_where_others_are_words(tmp_path):
    """As pandas writes a frame with its index and numbered columns."""
    path = tmp_path / "a.csv"
    path.write_text(",tap,label,0,1,2\n0,1,cup,0.5,1.5,2.5\n1,2,cup,3.5,1.5,2.5\n2,3,rod,0.5,1.5,2.5\n")
    assert "header = false" not in look([path], TapMap())
    path.write_text("14:02:11,497,515\n14:02:12,498,515\n14:02:13,499,515\n")
    assert "header = false" in look([path], TapMap())
