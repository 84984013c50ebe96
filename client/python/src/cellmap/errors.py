"""The one exception of this package."""


class Error(Exception):
    """Something in the world went wrong: the network, the server, damaged bytes, a bad argument.

    ``code`` is one of the server's closed list (``schema/openapi.yaml``, "Problem"): ``invalid-argument``,
    ``not-found``, ``already-exists``, ``conflict``, ``precondition-failed``, ``corrupt-data``, ``unsupported``,
    ``too-large``, ``unavailable``, ``cancelled``, ``io``, ``unauthenticated``, ``permission-denied``, ``rate-limited``,
    ``disk-full``, ``internal`` and those that only HTTP knows. Errors that arise on this side
    have a code of the same list: a server that is not there is ``unavailable``.
    """

    def __init__(self, code: str, message: str, status: int | None = None) -> None:
        super().__init__(f"{code}: {message}")
        self.code = code
        self.message = message
        #: HTTP status of the answer; None where no answer came.
        self.status = status


def corrupt(message: str) -> Error:
    return Error("corrupt-data", message)


def unsupported(message: str) -> Error:
    return Error("unsupported", message)


def invalid(message: str) -> Error:
    return Error("invalid-argument", message)
