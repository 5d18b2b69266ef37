"""A runner of tasks for tests, without processes, and a task for runners with processes."""

import os
import time

import cloudpickle
from solidtouch.analysis.tasks.task import attempt


def through_pickle(tasks, work, load):
    """Runs tasks as other processes would, on copies of all that they are given; the last of four comes first."""
    data, waiting = {}, []
    for task in tasks:
        if task.data not in data:
            data[task.data] = cloudpickle.loads(cloudpickle.dumps(load(task.data)))
        theirs, does = cloudpickle.loads(cloudpickle.dumps((task, work)))
        waiting.append(cloudpickle.loads(cloudpickle.dumps(attempt(theirs, does, data[task.data]))))
        if len(waiting) == 4:
            yield from reversed(waiting)
            waiting.clear()
    yield from reversed(waiting)


def slow_square(item, folder):
    """The square, and a file for each time that it was begun, by which process."""
    begun = len(list(folder.glob(f"{item}-*")))
    (folder / f"{item}-{begun}-{os.getpid()}").touch()
    time.sleep(0.6)
    return item * item
