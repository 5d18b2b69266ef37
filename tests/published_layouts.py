"""Small copies of the layouts of published recordings: names, axes and types as published, made-up numbers."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import zarr
from numpy.typing import NDArray
from pyarrow import parquet
from scipy.io import savemat

GESTURES = (
    *("grab", "hit", "massage", "pat", "pinch", "poke", "press"),
    *("rub", "scratch", "slap", "squeeze", "stroke", "tap", "tickle"),
)


@dataclass(frozen=True)
class Facts:
    """What a map makes of a layout.

    Attributes:
        shape: Taps, samples and taxels.
        objects: Names of the objects.
        taps: Object, position, session and four samples of some taps by their number: of the first sample the first
            and second taxel, the first taxel of the second sample, and the last taxel of the last sample.
        positions: All positions.
        sessions: All sessions.
        rate_hz: Samples per second.
    """

    shape: tuple[int, int, int]
    objects: tuple[str, ...]
    taps: dict[int, tuple[str, float, int, tuple[float, float, float, float]]]
    positions: tuple[float, ...] = (0.0,)
    sessions: tuple[int, ...] = (0,)
    rate_hz: float | None = None
    extra: dict[str, list[float]] = field(default_factory=dict)


def counted(*shape: int, start: int = 0) -> NDArray[np.int64]:
    """Numbers that tell where they stand."""
    return np.arange(start, start + int(np.prod(shape))).reshape(shape)


def written(path: Path, rows: Iterable[Sequence[Any]], end: str = "", delimiter: str = ",") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(delimiter.join(map(str, row)) + end + "\n" for row in rows))


def bts3(folder: Path) -> Facts:
    fingers = [f"{finger}_biotac_{n}" for finger in ("ff", "mf", "th") for n in range(1, 25)]
    grasps = {"": [("coke", 0), ("apple", 1)], "_test": [("mug", 1)]}
    for i, hand in enumerate(("45", "down", "side")):
        for split, rows in grasps.items():
            start = 1000 * i + 500 * (split == "_test")
            cells = [(*row, *counted(72, start=start + 100 * j)) for j, row in enumerate(rows)]
            written(folder / f"bts3v2_palm_{hand}{split}.csv", [("object", "slipped", *fingers), *cells])
    (folder / "README.md").write_text("# Not a recording\n")
    return Facts(
        shape=(9, 1, 72),
        objects=("coke", "apple", "mug"),
        taps={
            0: ("coke", 0, 0, (0, 1, 0, 71)),
            2: ("mug", 0, 1, (500, 501, 500, 571)),
            7: ("apple", 0, 4, (2100, 2101, 2100, 2171)),
        },
        sessions=(0, 1, 2, 3, 4, 5),
        extra={"slipped": [0, 1, 1, 0, 1, 1, 0, 1, 1]},
    )


def biotac_slide(folder: Path) -> Facts:
    """Rows end with a comma, the header does not; recordings differ in length."""
    names = ["timestamp", "tdc", "tac", "pdc", *(f"pac{n}" for n in range(1, 23)), *(f"ele{n}" for n in range(1, 20))]
    for material in (1, 2):
        for recording in (1, 10):
            frames = 200 + recording
            time = 1581073084.69 + 0.01 * np.arange(frames)
            cells = counted(frames, 44, start=100_000 * material)
            rows = [(f"{t:.9f}", *row) for t, row in zip(time, cells, strict=True)]
            path = folder / f"raw_data/mat{material}/mat{material}_{recording}_bio.csv"
            written(path, rows, end=",")
            path.write_text(",".join(names) + "\n" + path.read_text())
            written(path.with_name(path.name.replace("_bio", "_cp")), [("timestamp", "posx"), (time[0], 0.7)])
            path.with_name(f"mat{material}_{recording}.pt").write_bytes(b"PK")
    return Facts(
        shape=(8, 100, 20),
        objects=("mat1", "mat2"),
        taps={
            0: ("mat1", 0, 1, (100_002, 100_025, 100_046, 104_399)),
            7: ("mat2", 0, 10, (204_402, 204_425, 204_446, 208_799)),
        },
        sessions=(1, 10),
        rate_hz=100.0,
    )


def biotac_slide_compiled(folder: Path) -> Facts:
    """Labels in an array file beside that of the samples."""
    (folder / "compiled_data").mkdir()
    for part, taps in (("test", 6), ("val_0", 4)):
        np.save(folder / f"compiled_data/bio_{part}.npy", counted(taps, 19, 40).astype(np.float32))
        np.save(folder / f"compiled_data/labels_{part}.npy", np.arange(taps) // 2 + 5)
    return Facts(
        shape=(6, 40, 19),
        objects=("5", "6", "7"),
        taps={0: ("5", 0, 0, (0, 40, 1, 759)), 5: ("7", 0, 0, (3800, 3840, 3801, 4559))},
    )


def txzy(folder: Path) -> Facts:
    """Tabs also at the ends of rows, no header, a file for each finger, and a row of -1000 after each contact."""
    for i, name in enumerate(("ball_1", "cylinder_1")):
        for sample in (1, 2):
            frames = counted(400, 22, start=10_000 * i)
            frames[[170, 340]] = -1000
            for finger in (1, 2, 3):
                path = folder / f"dataset_10_04_2014/{name}/{name}_pressure_sample_{sample}_f{finger}.txt"
                written(path, frames * finger, end="\t", delimiter="\t")
            where = folder / f"dataset_10_04_2014/{name}/{name}_position_sample_{sample}_f1.txt"
            written(where, [(8, 2, -7, 53)] * 400, end="\t", delimiter="\t")
    return Facts(
        shape=(8, 156, 22),
        objects=("ball_1", "cylinder_1"),
        taps={0: ("ball_1", 0, 1, (330, 331, 352, -1000)), 7: ("cylinder_1", 0, 2, (14_070, 14_071, 14_092, -1000))},
        sessions=(1, 2),
    )


def uskin_slip(folder: Path) -> Facts:
    """Arrays in groups by object, pose and grasp, with the samples along the last axis."""
    for i, name in enumerate(("SpoolSolder", "brush")):
        with h5py.File(folder / f"slipDataset_{name}_tactile.h5", "w") as file:
            for pose in (1, 2, 3):
                for grasp in (1, 10):
                    group = file.create_group(f"GGCNN2/{name}/Pose{pose}/Exp{grasp}")
                    frames = 180 + grasp
                    group["tactile_data_raw"] = counted(18, 3, frames, start=10**6 * i).astype(float)
                    group["tactile_timestamps"] = np.arange(frames) / 0.18
                    group["tactile_slips_label"] = np.zeros(frames, int)
                    group["tactile_changes_label"] = np.zeros(frames, int)
    return Facts(
        shape=(24, 90, 54),
        objects=("SpoolSolder", "brush"),
        taps={
            0: ("SpoolSolder", 1, 1, (0, 181, 1, 89 + 53 * 181)),
            23: ("brush", 3, 10, (1_000_090, 1_000_280, 1_000_091, 1_000_179 + 53 * 190)),
        },
        positions=(1.0, 2.0, 3.0),
        sessions=(1, 10),
        rate_hz=180.0,
    )


def phac_hold(folder: Path) -> Facts:
    """Trials are one sample longer or shorter."""
    (folder / "data").mkdir()
    for i, name in enumerate(("acrylic_211", "black_foam_110")):
        for trial in (1, 2, 10):
            frames = 1000 + (trial == 2)
            arrays = {
                "F0Electrodes": counted(19, frames, start=20_000 * i + trial),
                "F1Electrodes": counted(19, frames),
            }
            arrays |= {name: counted(n, frames) for name, n in (("F0pac", 22), ("F0pdc", 1), ("F0tac", 1))}
            arrays = {key: of.astype(np.uint16) for key, of in arrays.items()} | {"JPos": np.zeros((1, frames))}
            savemat(folder / f"data/{name}_{trial:02}_HOLD.mat", arrays)
    return Facts(
        shape=(6, 1000, 38),
        objects=("acrylic", "black_foam"),
        taps={0: ("acrylic", 0, 1, (1, 1001, 2, 18_999)), 5: ("black_foam", 0, 10, (20_010, 21_010, 20_011, 18_999))},
        sessions=(1, 2, 10),
    )


def ev_objects(folder: Path, name: str = "Ev-Objects", samples: int = 250) -> Facts:
    for split, numbers in (("test", (0, 10)), ("train", (0, 1, 2))):
        (folder / name / split).mkdir(parents=True)
        for number in numbers:
            spikes = np.zeros((39, 2, samples), np.float32)
            spikes[0, 1, 0] = spikes[38, 1, -1] = 1
            np.save(folder / f"{name}/{split}/sample_{number}_label_{number % 2 + 30}.npy", spikes)
    return Facts(
        shape=(5, samples, 78),
        objects=("30", "31"),
        taps={0: ("30", 0, 0, (0, 1, 0, 1)), 3: ("31", 0, 0, (0, 1, 0, 1))},
    )


def ev_containers(folder: Path) -> Facts:
    return ev_objects(folder, "Ev-Containers", 325)


def cluster_texture(folder: Path) -> Facts:
    data = folder / "texture_dataset/sensor_data"
    for texture in (0, 117):
        for direction in (0, 45, 315):
            for repeat in (0, 1):
                for speed in (20, 40):
                    name = f"{texture}_{direction}_{speed}_500_{repeat}.csv"
                    time = 0.001 + np.arange(700) / 6000
                    cells = counted(700, 3, start=10_000 * (texture + 1) + direction)
                    rows = [(t, *row) for t, row in zip(time, cells, strict=True)]
                    written(data / f"accel/{texture}/{name}", [("time", "X", "Y", "Z"), *rows])
                    written(data / f"force/{texture}/{name}", [("time", "force"), (0.001, 1.009)])
    return Facts(
        shape=(12, 600, 3),
        objects=("0", "117"),
        taps={
            0: ("0", 0, 0, (10_000, 10_001, 10_003, 11_799)),
            11: ("117", 315, 1, (1_180_315, 1_180_316, 1_180_318, 1_182_114)),
        },
        positions=(0.0, 45.0, 315.0),
        sessions=(0, 1),
        rate_hz=6000.0,
    )


def stag(folder: Path) -> Facts:
    n = 12
    names = np.array([["allen_key_set", "ball", "empty_hand"]], dtype=object)
    frame, odd = np.arange(n), np.arange(n) % 2
    column = {"objectId": frame // 4, "recordingId": 3 * (frame // 4) + odd, "frame": frame, "splitId": odd}
    column |= {"isBalanced": np.ones(n), "hasValidLabel": frame % 4 != 1}
    arrays = {key: of.astype(float)[:, None] for key, of in column.items()}
    pressure = counted(n, 32, 32).astype(np.uint16)
    (folder / "classification").mkdir()
    savemat(folder / "classification/metadata.mat", {"pressure": pressure, "objects": names, **arrays})
    return Facts(
        shape=(9, 1, 1024),
        objects=("allen_key_set", "ball", "empty_hand"),
        taps={0: ("allen_key_set", 0, 0, (0, 1, 0, 1023)), 8: ("empty_hand", 0, 7, (11_264, 11_265, 11_264, 12_287))},
        sessions=(0, 1, 3, 4, 6, 7),
    )


def eflesh(folder: Path) -> Facts:
    """Two files without header in the folder of each run, row for row; positions that differ by noise."""
    places = [(x, y + 0.00006 * k) for x in (274.0, 275.0) for y in (-115.0, -114.0) for k in range(2)]
    for i, run in enumerate(("20250316_155729", "20250317_134149")):
        time = 1742155052.5 + 4 * np.arange(len(places))
        cells = counted(len(places), 15, start=1000 * i)
        sensor = [(t, *row) for t, row in zip(time, cells, strict=True)]
        here = folder / f"characterization/datasets/spatial_resolution/{run}_probe"
        written(here / "sensor_post_baselines.csv", sensor)
        written(here / "sensor.csv", sensor)
        written(here / "states.csv", [(t + 0.002, x, y, 142.4) for t, (x, y) in zip(time, places, strict=True)])
    return Facts(
        shape=(16, 1, 15),
        objects=("object",),
        taps={0: ("object", 0, 0, (0, 1, 0, 14)), 15: ("object", 2, 1, (1105, 1106, 1105, 1119))},
        positions=(0.0, 1.0, 2.0, 3.0),
        sessions=(0, 1),
    )


def opentouch(folder: Path) -> Facts:
    (folder / "data/chunk-000").mkdir(parents=True)
    for episode in range(3):
        frames = 65
        grid = counted(frames, 16, 16, start=10**5 * episode).astype(np.float32)
        columns = {"observation.tactile_grid": pa.array(grid.tolist(), pa.list_(pa.list_(pa.float32())))}
        columns |= {"timestamp": pa.array((np.arange(frames) / 30).astype(np.float32))}
        numbers = {"frame_index": np.arange(frames), "episode_index": np.full(frames, episode)}
        numbers |= {"index": episode * frames + np.arange(frames), "task_index": np.full(frames, episode // 2)}
        columns |= {key: pa.array(of) for key, of in numbers.items()}
        parquet.write_table(pa.table(columns), folder / f"data/chunk-000/episode_{episode:06}.parquet")
    return Facts(
        shape=(6, 30, 256),
        objects=("0", "1"),
        taps={0: ("0", 0, 0, (0, 1, 256, 7679)), 5: ("1", 0, 2, (207_680, 207_681, 207_936, 215_359))},
        sessions=(0, 1, 2),
        rate_hz=30.0,
    )


def rmtac(folder: Path) -> Facts:
    for i, task in enumerate(("pick_crack_egg", "pour_oil_pan")):
        store = zarr.open_group(folder / f"RMtac/{task}.zarr", mode="w", zarr_format=2)
        frames = counted(70, 2, 12, 32, start=10**5 * i).astype(np.int32)
        store.create_array("data/right_tactile_data_gripper", data=frames, chunks=(32, 2, 12, 32))
        store.create_array("data/right_wrist_pose", data=np.zeros((70, 6)))
        store.create_array("meta/episode_ends", data=np.array([30, 70]))
    return Facts(
        shape=(4, 30, 768),
        objects=("pick_crack_egg", "pour_oil_pan"),
        taps={
            0: ("pick_crack_egg", 0, 0, (0, 1, 768, 23_039)),
            3: ("pour_oil_pan", 0, 0, (123_040, 123_041, 123_808, 146_079)),
        },
    )


def vistouch(folder: Path) -> Facts:
    """Labels in a table that names the files by their path; the header of the samples is unknown."""
    names = ["clip_id", "session_id", "material_english", "force_n", "audio_path", "tactile_path"]
    clips = []
    for i, material in enumerate(("brass", "silk")):
        for clip in (1, 2):
            stem = f"dataset/tactile/{material}/{material}_tactile_{clip:06}.csv"
            written(folder / stem, [("first", "second"), *((j / 100, 1000 * i + 10 * clip + j) for j in range(200))])
            audio = stem.replace("tactile", "audio").replace("csv", "wav")
            clips.append((f"{material}_{clip:06}", f"{material}_f{3 * clip}_r1_v1", material, 3 * clip, audio, stem))
    written(folder / "metadata/clips_index.csv", [names, *reversed(clips)])
    return Facts(
        shape=(4, 200, 1),
        objects=("brass", "silk"),
        taps={0: ("brass", 0, 0, (10, 10, 11, 209)), 3: ("silk", 0, 3, (1020, 1020, 1021, 1219))},
        sessions=(0, 1, 2, 3),
        rate_hz=100.0,
    )


def icub_forearm(folder: Path) -> Facts:
    """Logs of YARP: a counter, a time and 384 taxels between blanks."""
    for i, material in enumerate(("bathTowel", "yogaMat")):
        for part in ("touch_raw", "touch_raw2"):
            frames = np.zeros((400, 384))
            frames[100:130, 7] = frames[280:300, 7] = 40 + i
            frames[91::180, 0], frames[90::180, 1] = 2, 1
            frames[:, 192:] = 99
            rows = [(29763 + 2 * j, f"{1531035174.9 + j / 50:.6f}", *row) for j, row in enumerate(frames)]
            written(folder / f"data/{material}/{part}/right_forearm_comp/data.log", rows, delimiter=" ")
            arm = folder / f"data/{material}/{part}/right_arm_encoders/data.log"
            written(arm, [row[:18] for row in rows], delimiter=" ")
        (folder / f"data/{material}/README").write_text("Description\n")
    return Facts(
        shape=(8, 100, 192),
        objects=("bathTowel", "yogaMat"),
        taps={0: ("bathTowel", 0, 1, (0, 1, 2, 0)), 7: ("yogaMat", 0, 0, (0, 1, 2, 0))},
        sessions=(0, 1),
        rate_hz=50.0,
    )


def cost(folder: Path) -> Facts:
    """All captures one after the other, told apart by the number of the frame; names of channels are made up."""
    names = ["subject", " variant", " gesture", " frame", *(f" ch{n}" for n in range(1, 65))]
    rows: list[Sequence[Any]] = []
    for subject in (1, 31):
        for variant in (1, 3):
            for gesture in (1, 14):
                for length in (60, 54, 20):
                    cells = counted(length, 64, start=1000 * subject + 100 * gesture + variant)
                    rows += [(subject, variant, gesture, j + 1, *row) for j, row in enumerate(cells)]
    written(folder / "CoST.csv", [names, *rows])
    return Facts(
        shape=(16, 54, 64),
        objects=GESTURES,
        taps={0: ("grab", 0, 1, (1101, 1102, 1165, 4556)), 15: ("tickle", 0, 31, (32_403, 32_404, 32_467, 35_858))},
        sessions=(1, 31),
        rate_hz=135.0,
        extra={"variant": [1.0] * 4 + [3.0] * 4 + [1.0] * 4 + [3.0] * 4},
    )


LAYOUTS: dict[str, Callable[[Path], Facts]] = {
    "bts3": bts3,
    "biotac-slide": biotac_slide,
    "biotac-slide-compiled": biotac_slide_compiled,
    "txzy": txzy,
    "uskin-slip": uskin_slip,
    "phac-hold": phac_hold,
    "ev-objects": ev_objects,
    "ev-containers": ev_containers,
    "cluster-texture": cluster_texture,
    "stag": stag,
    "eflesh": eflesh,
    "opentouch": opentouch,
    "rmtac": rmtac,
    "vistouch": vistouch,
    "icub-forearm": icub_forearm,
    "cost": cost,
}
"""By name of the map in docs/datasets."""
