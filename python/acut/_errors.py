"""Errors as exceptions: a class for each code of base/err.def, all subclasses of Error."""
from typing import Dict, Optional, Type


class Error(Exception):
    """A failure that acut names. Read aloud: which file, where in it, what is wrong, and what to do.

    code         the frozen name, as "bad-input"
    message      what is wrong
    file         the input it is about, or None
    offset       the byte in it, or None
    field        the field of its header, the key of a document; or None
    hint         what to do, or None
    exit_status  what acutctl ends with for it
    """

    code = "internal"
    exit_status = 1

    def __init__(self, message: str, *, file: Optional[str] = None, offset: Optional[int] = None,
                 field: Optional[str] = None, hint: Optional[str] = None) -> None:
        super().__init__(message)
        self.message, self.file, self.offset, self.field, self.hint = message, file, offset, field, hint

    def __str__(self) -> str:
        place = [] if self.offset is None else ["byte %d" % self.offset]
        place += [self.field] if self.field else []
        parts = [self.file] if self.file else []
        parts += [", ".join(place)] if place else []
        text = ": ".join(parts + [self.message or self.code])
        return "%s (%s)" % (text, self.hint) if self.hint else text

    def __reduce__(self):
        return _again, (type(self), self.message, self.file, self.offset, self.field, self.hint)


def _again(kind, message, file, offset, field, hint):
    return kind(message, file=file, offset=offset, field=field, hint=hint)


class InputError(Error):
    """The input is broken or cannot be used."""
    code, exit_status = "bad-input", 1


class TruncatedError(InputError):
    """The input has less data than its header says."""
    code, exit_status = "truncated", 1


class ChangedError(InputError):
    """The input changed while it was read."""
    code, exit_status = "changed", 1


class LimitError(Error):
    """It can never fit into the limits that are set."""
    code, exit_status = "does-not-fit", 1


class CancelledError(Error):
    """The job was cancelled."""
    code, exit_status = "cancelled", 1


class GoneError(Error):
    """The stream cannot be continued."""
    code, exit_status = "stream-gone", 1


class DigestError(Error):
    """The digests do not agree."""
    code, exit_status = "digest-mismatch", 1


class InternalError(Error):
    """A fault in acut itself."""
    code, exit_status = "internal", 1


class UsageError(Error, ValueError):
    """The request is not well formed."""
    code, exit_status = "usage", 2


class UnsupportedError(Error):
    """This version of acut does not support that."""
    code, exit_status = "not-in-this-version", 2


class NotFoundError(Error, LookupError):
    """There is no such job or dataset."""
    code, exit_status = "not-found", 4


class NoDaemonError(Error, ConnectionError):
    """No daemon answers, or it went away."""
    code, exit_status = "no-daemon", 69


class ReadWriteError(Error):
    """Reading or writing failed."""
    code, exit_status = "io", 74


class NoSpaceError(Error):
    """There is no space left."""
    code, exit_status = "no-space", 74


class CorruptError(Error):
    """Stored data is damaged."""
    code, exit_status = "corrupt", 74


class BusyError(Error):
    """Not possible now; try again later."""
    code, exit_status = "busy", 75


class NoMemoryError(Error, MemoryError):
    """The system has no free memory."""
    code, exit_status = "out-of-memory", 75


class ProtocolError(Error):
    """The other side broke the protocol."""
    code, exit_status = "protocol", 76


class VersionError(Error):
    """The versions are incompatible."""
    code, exit_status = "version", 76


class NotPermittedError(Error, PermissionError):
    """Not permitted."""
    code, exit_status = "not-permitted", 77


class TimedOutError(Error, TimeoutError):
    """It took longer than the time-out."""
    code, exit_status = "timeout", 124


class ConflictError(Error):
    """It conflicts with what exists: a name is taken, a dataset is pinned."""
    code, exit_status = "conflict", 1


CLASSES: Dict[str, Type[Error]] = {c.code: c for c in (
    InputError, TruncatedError, ChangedError, LimitError, CancelledError, GoneError, DigestError, InternalError, UsageError,
    UnsupportedError, NotFoundError, NoDaemonError, ReadWriteError, NoSpaceError, CorruptError, BusyError, NoMemoryError,
    ProtocolError, VersionError, NotPermittedError, TimedOutError, ConflictError)}


def from_failure(failure) -> Error:
    """The exception for a struct acut_failure. An unknown code gives an Error with that code."""
    def text(raw):
        return raw.decode(errors="replace") if raw else None

    name = text(failure.name) or "internal"
    known = CLASSES.get(name)
    error = (known or Error)(text(failure.message) or "", file=text(failure.file), field=text(failure.field),
                             hint=text(failure.hint), offset=None if failure.offset == 2**64 - 1 else failure.offset)
    if not known:
        error.code, error.exit_status = name, failure.exit_status
    return error
