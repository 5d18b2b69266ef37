"""`solidtouch perceive`: live episodes of perception on any rig."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Context, Option

from ..models.errors import InputError
from ..models.settings import PlaySettings
from .shared.completion import rigs, rules, strategies
from .shared.homing import Home, Yes, confirm_homing
from .shared.interrupt import loading
from .shared.options import Fields, Force, Missing, SettingFile, Story, TrainingTaps, given, merged, spelled_out
from .shared.recording import check_record, kept, recording
from .shared.untrained import untrained

if TYPE_CHECKING:
    from ..analysis.live.ending import Ending
    from ..analysis.live.view import Seen
    from ..hardware.named_rigs import ChosenRig, Wish
    from ..inference import reference
    from ..inference.engines.engine import Engine
    from ..inference.novelty import Novelty
    from ..models.measurement.model import TapModel
    from ..models.setting_file import Setting

_Theta = Annotated[float, Option("--theta", help="Belief in an object required for a decision; 1 never decides.")]
_Deadline = Annotated[
    int, Option("--deadline", min=1, help="Maximum number of taps; the most probable object is then decided.")
]


@spelled_out
def perceive(
    context: Context,
    model: Annotated[Path, Argument(metavar="MODEL", help="Fitted model, from `fit`.", show_default=False)],
    rig: Annotated[
        str,
        Option(
            metavar="RIG",
            help="Source of taps: simulated, simulated:PRESET, replay:FILE or a rig.toml.",
            autocompletion=rigs,
        ),
    ] = "simulated",
    engine: Annotated[
        Literal["numpy", "numpyro", "filter"], Option(help="Engine that computes the beliefs.")
    ] = "numpyro",
    play: Annotated[
        PlaySettings,
        Fields("passive", "fixation", "theta_x", "border", threshold=_Theta, deadline=_Deadline),
    ] = PlaySettings(),
    move: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Control strategy: passive, fixation[:THETA_X], random, step[:REACH], table, or info-what, info-where "
            "or info-joint, each also with -per-mm or -per-s.",
            autocompletion=strategies,
        ),
    ] = None,
    training: Annotated[
        list[Path] | None,
        Option(
            metavar="FILE", help="Taps that trained the model, for strategies and rules that look ahead; repeatable."
        ),
    ] = None,
    targets: Annotated[
        Path | None, Option(metavar="FILE.json", help="Learned table of targets for --move table.")
    ] = None,
    stop: Annotated[
        str | None,
        Option(
            metavar="RULE",
            help="Stopping rule: what:THETA, where:THETA, both:THETA_W,THETA_X, taps:N, error:P, each-error:P, "
            "msprt:COST or lookahead:COST, such as where:0.9.",
            autocompletion=rules,
        ),
    ] = None,
    give_up: Annotated[
        str | None,
        Option(
            "--give-up",
            metavar="TAPS[:BELIEF]",
            help="Give up after TAPS taps, unless the belief in an object exceeds BELIEF.",
        ),
    ] = None,
    start: Annotated[
        str | None, Option(help="Initial position: a position index from 0 or a length such as 2.3mm; default: random.")
    ] = None,
    what: Annotated[
        str | None,
        Option("--object", help="Object by name or index from 0; on a real rig only for judging the answer."),
    ] = None,
    episodes: Annotated[int, Option(min=1, help="Number of episodes.")] = 1,
    unknown: Annotated[
        float | None,
        Option(
            metavar="ALPHA",
            help="Answer `unknown` if no trained object explains the taps. With 95% confidence over training taps, "
            "at most a fraction ALPHA of episodes at a trained object end in `unknown`, if new taps are distributed "
            "like the training taps.",
        ),
    ] = None,
    as_json: Annotated[
        bool, Option("--json", help="Print one JSON object per tap and decision instead of pictures.")
    ] = False,
    shadow: Annotated[
        bool, Option("--shadow", help="Run a second engine in parallel; exit code 1 if they disagree.")
    ] = False,
    image: Annotated[
        Path | None, Option("--picture", metavar="FILE.svg", help="Save the last picture to this file.")
    ] = None,
    record: Annotated[
        Path | None,
        Option("--record", metavar="FILE.mcap", help="Record all data of the rig to this file; requires a rig.toml."),
    ] = None,
    save_episode: Annotated[
        Path | None,
        Option("--save-episode", metavar="FILE.json", help="Save all taps and beliefs to this file, for `view`."),
    ] = None,
    view: Annotated[bool, Option("--view", help="Show the episodes on a page in the browser.")] = False,
    view_port: Annotated[
        int | None, Option("--view-port", min=1, max=65535, help="Port of the page; default: a free one.")
    ] = None,
    no_browser: Annotated[bool, Option("--no-browser", help="Print the address of the page and open nothing.")] = False,
    pace: Annotated[
        float | None,
        Option(
            "--pace",
            min=0.0,
            max=3600.0,
            metavar="SECONDS",
            help="Minimum time between taps; default: 0.5 in a terminal or on a page if the rig is simulated or "
            "replayed, otherwise 0.",
        ),
    ] = None,
    home: Home = False,
    yes: Yes = False,
    story: Story = None,
    training_taps: TrainingTaps = False,
    missing: Missing = "refuse",
    setting: SettingFile = None,
    seed: Annotated[
        int, Option("--seed", min=0, max=2**63 - 1, help="Random seed of the episodes: start, object, noise, replay.")
    ] = 0,
    sensor_seed: Annotated[
        int | None,
        Option(
            "--sensor-seed",
            min=0,
            max=2**63 - 1,
            help="With --rig simulated: seed of the sensor, as the --seed of `simulate`; default: that of the taps "
            "that trained the model, 0 if unknown.",
        ),
    ] = None,
    force: Force = False,
) -> None:
    """Perceive an object and its position by tapping, and show the belief after each tap."""
    _check_rig(rig, training_taps, home, yes)
    _check_together(play, move, stop, given(context, "threshold"))
    read = None
    if setting is not None:
        with loading():
            from ..models.setting_file import load_setting

        read = load_setting(setting)
        play = _with_setting(context, read, play, move)
    if image is not None:
        check_picture(image, force)
    if record is not None:
        check_record(record, rig, force)
    with loading():
        from .shared.watching import Watching, watching

        watched = Watching.checked(view, view_port, no_browser, save_episode, force)
        from ..hardware.named_rigs import Wish
        from ..models.io.model_file import load_model

        fitted = load_model(model, story, missing)
        if read is not None:
            read.check_model(fitted, str(model), str(setting))
        chosen = _chosen(rig, fitted, Wish(start, what, seed, sensor_seed), training_taps, missing)
        # Also what is needed only later: nothing may be imported while a finger is on its way.
        from ..inference.engines.latency import TimedEngine
        from .shared.episode_run import EpisodeRun, TapPace, default_pace, warmed_up
        from .shared.moving import choose_moves, load_outcomes
        from .shared.showing import latency_sentence, show
        from .shared.stopping import choose_ends

        name = move or ("passive" if play.passive else f"fixation:{play.theta_x!r}")
        outcomes = load_outcomes(fitted, training, name, stop)
        moves = choose_moves(name, fitted, play, outcomes, targets)
        ends = choose_ends(stop, play, give_up, fitted, moves.fixation, outcomes)
        novelty, engines = _novelty(fitted, unknown, play.deadline), _engines(engine, fitted, play.border, shadow)
        warm_up_s = warmed_up(engines, as_json)
    steady = TapPace(default_pace(rig, as_json, view) if pace is None else pace)
    timed = TimedEngine(engines)
    run = EpisodeRun(timed, ends, moves, seed, play.deadline, novelty, unknown, steady)
    with (
        recording(record, rig, fitted.grid, what, episodes * play.deadline, force) as recorder,
        show(as_json) as printed,
        watching(printed, watched) as shown,
    ):
        if rig.endswith(".toml"):
            shown.note(f"Connecting to the rig of {rig}; the finger must touch nothing.")
        with chosen(home, recorder) as source:
            shown.note(
                f"{source.name}, engine {timed.name}, warmed up in {warm_up_s:.1f} s; beliefs follow object and "
                f"position, moves are in positions{_promised(novelty, unknown)}"
            )
            endings = run.episodes(source, episodes, shown)
        if episodes > 1:
            shown.note(_summary(endings))
        shown.note(latency_sentence(timed.latency(), warm_up_s))
        if recorder is not None:
            shown.note(kept(recorder))
    if image is not None:
        save_picture(endings[-1].seen, image, force)


def _check_rig(rig: str, training_taps: bool, home: bool, yes: bool) -> None:
    with loading():
        from ..hardware.named_rigs import check_training_taps

    check_training_taps(training_taps, rig)
    confirm_homing(rig, home, yes)


def _chosen(
    rig: str, fitted: "TapModel", wish: "Wish", training_taps: bool, missing: Literal["refuse", "drop"]
) -> "ChosenRig":
    """The rig, checked with object and start; warns if it has another finger than the one that trained the model."""
    from ..hardware.named_rigs import choose_rig, sensor_of

    sensor, doubt = sensor_of(rig, fitted.source, wish.sensor)
    if doubt:
        print(doubt, file=sys.stderr)
    fresh = partial(untrained, fitted, keep=training_taps)
    return choose_rig(rig, fitted.grid, wish._replace(sensor=sensor), fresh, missing)


def _check_together(play: PlaySettings, move: str | None, stop: str | None, theta: bool) -> None:
    """Checks that options do not contradict each other; `theta` is whether `--theta` is given."""
    if play.passive and (play.fixation is not None or play.theta_x > 0):
        raise InputError("--passive cannot be combined with --fixation or --theta-x.")
    if move is not None and (play.passive or play.theta_x > 0):
        raise InputError("--move cannot be combined with --passive or --theta-x; use --move fixation:THETA_X.")
    if stop is not None and theta:
        raise InputError("--stop cannot be combined with --theta; use --stop what:THETA.")


def _with_setting(context: Context, setting: "Setting", play: PlaySettings, move: str | None) -> PlaySettings:
    """Values of the command line, else of a setting.

    Options for moving replace each other: `--passive` on the command line replaces the setting's fixation point and
    move threshold, either of these replaces a passive setting, and `--move` replaces all three except for the fixation
    point of a strategy that uses one.
    """
    both = merged(context, setting, play)
    if given(context, "passive"):
        return both.changed(theta_x=0.0, fixation=None)
    if move is not None:
        aims = move.partition(":")[0] == "fixation"
        return both.changed(theta_x=0.0, passive=False, fixation=both.fixation if aims else play.fixation)
    return both.changed(passive=both.passive and not (given(context, "theta_x") or given(context, "fixation")))


def check_picture(path: Path, force: bool) -> None:
    """Checks that a picture can be written at the end.

    Raises:
        InputError: The name does not end in `.svg`, or the file cannot be written.
    """
    from ..models.storage import check_writable

    if path.suffix.lower() != ".svg":
        raise InputError(f"--picture must name an .svg file, got {path}.")
    check_writable(path, force)


def save_picture(seen: "Seen", path: Path, force: bool) -> None:
    """Writes the picture of one step, atomically.

    Raises:
        InputError: The file cannot be written.
    """
    from ..analysis.live.picture import live_picture
    from ..models.storage import complete_file

    with complete_file(path, force) as temporary:
        temporary.write_text(live_picture(seen), encoding="utf-8")


def _novelty(model: "TapModel", alpha: float | None, deadline: int) -> "Novelty | None":
    """P-values if the model supports them, which the answer `unknown` requires."""
    from ..inference.novelty import Novelty, can_tell

    if alpha is None:
        return Novelty(model) if can_tell(model) else None
    if not 0 < alpha < 1:
        raise InputError(f"--unknown must be between 0 and 1, got {alpha}.")
    novelty = Novelty(model)
    promise = novelty.promise(alpha)
    if promise.soonest is None or promise.soonest > deadline:
        raise InputError(
            f"--unknown {alpha:g} is not possible within the --deadline of {deadline} taps: {promise.power}."
        )
    return novelty


def _promised(novelty: "Novelty | None", alpha: float | None) -> str:
    """Guarantee for the answer `unknown`, if it is possible."""
    return "" if novelty is None or alpha is None else f". {novelty.promise(alpha).sentence}"


def _engines(name: str, model: "TapModel", border: "reference.Border", shadow: bool) -> "Engine":
    from ..inference.engines.engine import make_engine
    from ..inference.engines.shadow import ShadowEngine

    chosen = make_engine(name, model, border)
    if not shadow:
        return chosen
    return ShadowEngine(chosen, make_engine("numpyro" if name == "numpy" else "numpy", model, border))


def _summary(endings: "list[Ending]") -> str:
    taps = sum(ending.seen.step.number for ending in endings) / len(endings)
    judged = [ending.right for ending in endings if ending.right is not None]
    right = f", {sum(judged)} of {len(judged)} objects right" if judged else ""
    given_up = sum(ending.answer is None for ending in endings)
    null = f", {given_up} null decision{'s' * (given_up > 1)}" if given_up else ""
    left = sum(ending.reason == "no class left" for ending in endings)
    none = f", {left} with no class left" if left else ""
    return f"{len(endings)} episodes of {taps:.1f} taps on average{right}{null}{none}."
