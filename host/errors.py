"""The one error a user is meant to read: what happened, why, and the next step."""


class UserError(Exception):
    """A failure in one to three lines.

    what: the thing that failed; why: its cause, as far as it is known; next_step: what to do now.
    """

    def __init__(self, what: str, why: str = "", next_step: str = "") -> None:
        super().__init__("\n".join(line for line in (what, why, next_step) if line))
        self.what = what
        self.why = why
        self.next_step = next_step


def cannot_write(what: object, error: OSError, next_step: str) -> UserError:
    """The error of a file, or what else `what` names, that could not be written."""
    return UserError(f"cannot write {what}", error.strerror or str(error), next_step)


def one_line(text: str) -> str:
    """Lines joined by semicolons."""
    return "; ".join(text.splitlines())
