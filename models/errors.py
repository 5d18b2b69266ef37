"""Errors that a user can fix."""


class InputError(ValueError):
    """Invalid data, option or file.

    The message is one sentence that names the file, array or argument and the place in it. Commands print it
    without a traceback and exit with code 2.
    """
