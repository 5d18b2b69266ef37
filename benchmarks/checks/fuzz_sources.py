"""Valid small files of every format that commands read, which `fuzz_files` damages."""

import json
import shutil
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat
from solidtouch.analysis.conformance.catalogue import expected, own_kit
from solidtouch.analysis.sweep.run import sweep
from solidtouch.analysis.tasks.local import in_this_process
from solidtouch.hardware.recording.plan import load_plan
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.hardware.rig.settings import load_rig
from solidtouch.hardware.skin.skin import SkinFrame
from solidtouch.inference.moves.table import TargetTable, save_table
from solidtouch.inference.tuning.online import Learner, save_learner
from solidtouch.models.io.export import Decisions, save_exported
from solidtouch.models.io.load import load_taps
from solidtouch.models.setting_file import Setting

import solidtouch as st

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
CASE = "root-j"
SWEPT = """
name = "small"
trials = 2
thresholds = [0.5, 0.9]
deadline = 5
[[data]]
name = "rods"
files = ["taps.nc"]
split = "parity"
[grid]
pseudocount = [0.01, 0.1]
"""


def write_files(folder: Path) -> dict[str, Path]:
    """A valid file or store of each format."""
    n, names = np.arange(12), np.array(["thin", "thick"])
    arrays: dict[str, Any] = {
        "taps": np.sin(n[:, None, None] + np.arange(4)[:, None] * np.arange(1, 4)).round(3),
        "what": n % 2,
        "where": n // 2 % 3,
        "session": n // 6,
        "where_values": np.arange(3.0),
    }
    files = {name: folder / f"taps.{name}" for name in ("npz", "nc", "zarr", "csv")}
    files |= {name: folder / f"{name}.mat" for name in ("mat5", "mat73")}
    np.savez_compressed(files["npz"], **arrays, what_names=names, meta=np.array(json.dumps({"rate_hz": 50})))
    savemat(files["mat5"], arrays | {"what_names": names.astype(object), "where_unit": "mm"}, oned_as="column")
    with h5py.File(files["mat73"], "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=np.atleast_2d(values).astype(float).T, compression="gzip")
        cells = [file.create_dataset(f"#refs#/{name}", data=[[ord(letter)] for letter in name]) for name in names]
        for cell in cells:
            cell.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("what_names", data=np.array([[cell.ref for cell in cells]], dtype=h5py.ref_dtype))
        file["what_names"].attrs["MATLAB_class"] = np.bytes_("cell")
    taps = load_taps(files["npz"])
    taps.save(files["nc"])
    taps.dataset.to_zarr(files["zarr"], consolidated=False)
    head = "tap,what,where,session,taxel_0,taxel_1,taxel_2\n"
    rows = [(i, names[i % 2], i // 2 % 3, i // 6, *frame) for i in n for frame in arrays["taps"][i]]
    files["csv"].write_text(head + "\n".join(",".join(map(str, row)) for row in rows) + "\n", encoding="utf-8")
    files |= _other_layouts(folder, arrays, names[arrays["what"]])
    model = st.fit(taps)
    files |= {"model": folder / "model.nc", "export": folder / "model.json", "setting": folder / "setting.json"}
    model.save(files["model"])
    save_exported(model, files["export"], Decisions("uniform", 0.9, 0.9, 1))
    Setting().save(files["setting"])
    for name in ("rig", "plan", "study"):
        files[name] = folder / f"{name}.toml"
        shutil.copy(EXAMPLES / f"{name}.toml", files[name])
    files |= {"mcap": folder / "taps.mcap", "resumed": folder / "resumed.mcap"}
    _record(files["mcap"], files["rig"], files["plan"])
    shutil.copy(files["mcap"], files["resumed"])
    files |= {"targets": folder / "targets.json", "learner": folder / "learner.json"}
    loss = np.ones((3, 3))
    save_table(TargetTable(n[:3], loss, loss, loss.astype(int), n[:3] + 0.5, "error", 1), files["targets"])
    save_learner(Learner.new("thompson", (0, 1), (0.5, 0.9), setup={"taps": "taps.nc"}), files["learner"])
    (folder / "swept.toml").write_text(SWEPT, encoding="utf-8")
    files |= {"sweep": folder / "swept.zarr", "answers": folder / "answers", "csvs": folder / "csvs"}
    sweep(folder / "swept.toml", files["sweep"], in_this_process)
    for name in ("answers", "csvs"):
        files[name].mkdir()
    for name in ("thin", "thick"):
        shutil.copy(files["csv"], files["csvs"] / f"{name}.csv")
    answers = [json.dumps(answer.line(CASE)) for answer in expected(*own_kit().select([CASE]))]
    (files["answers"] / f"{CASE}.jsonl").write_text("\n".join(answers), encoding="utf-8")
    return files


def _other_layouts(folder: Path, arrays: dict[str, Any], objects: NDArray[np.str_]) -> dict[str, Path]:
    """The same taps in the layouts of `fuzz_files.MAPS`."""
    import pandas as pd  # noqa: PLC0415

    files = {name: folder / f"other.{name}" for name in ("parquet", "arrow", "jsonl", "txt", "npy", "h5")}
    taps, place = arrays["taps"], arrays["where"]
    frame = pd.DataFrame({"signal": taps.tolist(), "object": objects, "place": place})
    frame.to_parquet(files["parquet"])
    frame.to_feather(files["arrow"])
    frame.to_json(files["jsonl"], orient="records", lines=True)
    N, J, K = taps.shape
    rows = pd.DataFrame(taps.reshape(-1, K), columns=[f"s{k}" for k in range(K)])
    press = np.repeat(np.arange(N), J)
    rows.assign(press=press, object=objects[press], place=place[press], t=np.arange(N * J) / 50).to_csv(
        files["txt"], sep=";", index=False
    )
    np.save(files["npy"], taps)
    with h5py.File(files["h5"], "w") as file:
        for session in range(2):
            of, group = arrays["session"] == session, file.create_group(f"run_{session}")
            group.create_dataset("taps", data=taps[of], compression="gzip")
            group["place"], group["object"] = place[of], [name.encode() for name in objects[of]]
    return files


def _record(path: Path, rig: Path, plan: Path) -> None:
    """Writes a recording of four taps as the rig does."""
    settings, seconds = load_rig(rig), count(100.0, 0.02)
    taxels = np.arange(12.0)
    with Recorder.create(
        path, about_rig(settings, rig.read_text("utf-8"), load_plan(plan)), lambda: 10**18
    ) as recorder:
        recorder.event(next(seconds), "stream", "the readings start")
        for trial in range(4):
            recorder.command(next(seconds), "stage", b"$J=G53X-52.5000Y-40.0000F1200\n")
            recorder.status(next(seconds), "Idle", (7.5, 0.0))
            for i in range(settings.preprocessing.samples):
                if i == settings.preprocessing.pre_samples:
                    label = {"trial": trial, "what": trial % 2, "where_mm": 1.5 + trial // 2, "session": 0}
                    recorder.press(next(seconds), label)
                raw = 240 - (i * taxels) % 17
                recorder.frame(SkinFrame(next(seconds), raw, 255 - raw, raw > 2, 20.0 * i))
            recorder.tap(next(seconds), accepted=True, reason="")
