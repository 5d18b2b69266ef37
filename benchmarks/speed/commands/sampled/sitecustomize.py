"""Counts the processor time of each stack of calls, from the start of Python to its end.

With the environment variable `SOLIDTOUCH_STACKS`, a folder, every Python process writes a file `PID.json` there:
`stacks`, each a list of calls, outermost first, with its seconds at the end, and `processor_s`, what the process and
those that it waited for have used until Python begins to take itself down. A thread notes every few milliseconds how
much processor time each thread has used since, and what it is calling. Time of threads unknown to Python, such as
XLA's, counts for the main thread, which waits for them. With `SOLIDTOUCH_INSIDE`, a function as `file:name`, only the
time counts while the main thread is in it.
"""

import os
import sys

PERIOD_S = 0.005


def _start(folder: str, inside: str) -> None:
    import atexit  # noqa: PLC0415 - only where stacks are wanted
    import json  # noqa: PLC0415
    import resource  # noqa: PLC0415
    import threading  # noqa: PLC0415
    from collections import Counter  # noqa: PLC0415

    counted: Counter[tuple[str, ...]] = Counter()
    main, ended, seen = threading.main_thread(), threading.Event(), {}

    def since(task: str) -> int:
        """Nanoseconds of processor time of a thread since the last call."""
        try:
            with open(f"/proc/self/task/{task}/schedstat", encoding="ascii") as file:  # noqa: PTH123
                now = int(file.read().split()[0])
        except OSError:  # it has just ended
            return 0
        before, seen[task] = seen.get(task, 0), now
        return now - before

    def sample() -> None:
        idents = {str(thread.native_id): thread.ident for thread in threading.enumerate()}
        frames = sys._current_frames()
        del frames[sampler.ident]  # this one, which would keep itself, and the arrays of all others with it
        counts = not inside or any(call.endswith(inside) for call in _calls(frames.get(main.ident)))
        for task in os.listdir("/proc/self/task"):  # noqa: PTH208
            ident = idents.get(task, main.ident)
            nanoseconds = since(task)
            if counts and nanoseconds and ident in frames:
                counted[_calls(frames[ident])] += nanoseconds

    def work() -> None:
        while not ended.wait(PERIOD_S):
            sample()

    def write() -> None:
        ended.set()
        sampler.join()
        used = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        processor_s = sum(one.ru_utime + one.ru_stime for one in used)
        stacks = [[*stack, nanoseconds / 1e9] for stack, nanoseconds in counted.items()]
        with open(f"{folder}/{os.getpid()}.json", "w", encoding="utf-8") as file:  # noqa: PTH123
            json.dump({"stacks": stacks, "processor_s": processor_s}, file)

    sampler = threading.Thread(target=work, daemon=True)
    atexit.register(write)
    sampler.start()


def _calls(frame) -> tuple[str, ...]:
    found = []
    while frame is not None:
        code = frame.f_code
        found.append(f"{code.co_filename}:{code.co_name}")
        frame = frame.f_back
    return tuple(reversed(found))


if os.environ.get("SOLIDTOUCH_STACKS") and os.path.isdir("/proc/self/task"):  # noqa: PTH112
    _start(os.environ["SOLIDTOUCH_STACKS"], os.environ.get("SOLIDTOUCH_INSIDE", ""))
