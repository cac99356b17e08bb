"""The one error of the pure rooms: what is wrong, and what to do about it."""


class InputError(ValueError):
    """Input that cannot be worked on.

    `code` is stable and made for programs, `message` says what is wrong and where, `hint` what to do.
    """

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(f"{message} {hint}".strip())
        self.code = code
        self.message = message
        self.hint = hint


class GeometryError(InputError):
    """A rotation, a transform or a camera model that is not one."""
