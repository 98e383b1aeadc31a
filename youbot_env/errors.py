"""The one exception that a user's mistake raises."""


class InputError(ValueError):
    """Input that cannot be used.

    ``str(error)`` is one line that says what is wrong, where (file, row, column) and what to do
    about it; the command line prints it and exits with status 2.
    """

    def __init__(self, message: str) -> None:
        # What a user's file holds may carry line breaks into the message.
        super().__init__(" ".join(str(message).splitlines()))
