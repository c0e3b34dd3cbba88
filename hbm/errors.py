"""The error a user can cause."""


class InputError(ValueError):
    """A file, key or option that cannot be accepted; exit status 2.

    The message is one line: ``<where>: <what was found>; <what is accepted>[; <what to try>]``.
    """
