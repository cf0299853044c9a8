"""Errors that a user can fix: every message names the file, the line or key, what was expected, and the remedy."""


class InputError(ValueError):
    """An input file or argument is wrong; the command line prints it as one line and exits with status 2."""
