"""Errors that a user can mend."""


class InputError(ValueError):
    """Data, an option or a file cannot be used.

    The message is one sentence that names the file, array or argument and the place in it. Commands print it
    without a traceback and exit with code 2.
    """
