"""libacut by ctypes: found, checked, and called in a way that loses no exception.

A Python function that C calls cannot raise: ctypes prints what comes out of it and goes on. A signal's handler (that of
Ctrl-C raises KeyboardInterrupt) runs where the interpreter next looks, and while C waits that is the first instruction of
just such a function, before any `try` in it. Therefore C never calls a function of Python here but the `send` of a
generator that waits inside of its `try` (guard). What it catches is kept, makes the call end as soon as C asks, and is
raised when the call has come back (State.call).
"""
import contextlib
import ctypes
import functools
import os
import threading
from typing import Any, Callable, Iterator, List, Optional

from . import _abi as abi
from ._errors import NoMemoryError, UsageError, VersionError, from_failure

_lock = threading.Lock()
_library: Optional[ctypes.CDLL] = None


def library() -> ctypes.CDLL:
    """libacut.so.0, or what ACUT_LIBRARY names; loaded when it is first needed."""
    global _library
    with _lock:
        if _library is None:
            _library = _load(os.environ.get("ACUT_LIBRARY") or "libacut.so.0")
        return _library


def _load(path: str) -> ctypes.CDLL:
    try:
        lib = ctypes.CDLL(path)
    except OSError as e:
        raise ImportError("libacut cannot be loaded: %s; install it (libacut0), or name it by ACUT_LIBRARY" % e) from None
    want = abi.VERSION.split(".")[:2]
    try:
        lib.acut_version.restype = ctypes.c_char_p
        have = lib.acut_version().decode()
    except AttributeError:
        have = "older than 0.1.0"
    if have.split(".")[:2] != want:
        raise VersionError("%s is libacut %s, and this module goes with %s" % (path, have, abi.VERSION),
                           hint="install both of the same release")
    for name, (result, arguments) in abi.FUNCTIONS.items():
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


def guard(state: "State", function: Callable[..., Any], count: int) -> Callable[..., Any]:
    """What ctypes may call with `count` addresses: gives 0, or something else to end the call."""
    return _collect(_guarded(state, function, count), count)


def _collect(generator, count):
    next(generator)
    if count == 1:
        return generator.send
    # max() hands one argument after the other to `send` without an instruction of Python, and gives the one with the
    # greatest answer, the first of equals: 0, the `ctx` that is never used, or the last address where the answer was 1.
    return functools.partial(max, key=generator.send)


def _guarded(state, function, count):
    answer, arguments, over = 0, [], False
    while True:
        try:
            while True:
                arguments.append((yield answer))
                answer = 0
                if len(arguments) == count:
                    given, arguments = arguments, []
                    answer = 1 if over or function(*given) else 0
        except GeneratorExit:
            return
        except BaseException as e:  # also KeyboardInterrupt: raised again by State.call
            state.fail(e)
            answer, arguments = 1, []
            over = count > 1  # it may have been between two arguments: these are of no use any more


NO_LIST = abi.acut_progress_fn()  # a NULL of any function (void *, const struct ... *)


class State:
    """What a connection and its callbacks share. It does not know the connection, which must not wait for the collector
    of cycles before it is closed."""

    def __init__(self) -> None:
        self.handle = ctypes.c_void_p()
        self.lock = threading.Lock()
        self.error: Optional[BaseException] = None
        self.keep: list = []  # what C has the address of
        self.fetch: Any = None  # a weak reference to the Fetch that runs

    def fail(self, error: BaseException) -> None:
        if self.error is None:
            self.error = error

    def interrupted(self, ctx: int) -> bool:
        return self.error is not None

    def call(self, function: Callable[..., int], *arguments: Any) -> int:
        """Calls it on the connection. What a callback has raised is raised; so is the failure of the call."""
        with Exclusive(self):
            return self.ask(function, self.handle, *arguments)

    def ask(self, function: Callable[..., int], *arguments: Any) -> int:
        """The same for who has the lock; `arguments` are all."""
        self.error = None
        r = function(*arguments)
        error, self.error = self.error, None
        if error is not None:
            try:
                raise error
            finally:
                error = None
        if r < 0:
            raise self.failure()
        return r

    def failure(self):
        if not self.handle:
            return NoMemoryError("there is no memory for a connection")
        return from_failure(library().acut_error(self.handle).contents)


class Exclusive:
    """One thread at a time, and no call while a fetch of the same connection goes on or a callback runs."""

    def __init__(self, state: State, fetch: Any = None) -> None:
        self.state, self.fetch = state, fetch

    def __enter__(self) -> None:
        if not self.state.lock.acquire(blocking=False):
            raise UsageError("this connection is in use, by another thread or by the call that this callback belongs to",
                             hint="open a connection for each thread")
        running = self.state.fetch() if self.state.fetch else None
        try:
            if not self.state.handle:
                raise UsageError("this connection is closed")
            if running is not None and running is not self.fetch:
                raise UsageError("a fetch goes on on this connection",
                                 hint="take all of its blocks, close it, or open a second connection")
        except BaseException:
            self.state.lock.release()
            raise

    def __exit__(self, *exc: Any) -> None:
        self.state.lock.release()


def close(state: State) -> None:
    """Of a connection that nobody uses any more."""
    handle, state.handle = state.handle, ctypes.c_void_p()
    if handle:
        library().acut_close(handle)
    state.keep.clear()


@contextlib.contextmanager
def opened(path: Any) -> Iterator[int]:
    """A descriptor of a file to be read. Not blocking: a named pipe without a writer must not hold up all."""
    fds: List[int] = []
    closing = map(os.close, fds)
    try:
        # In one call of C each, so that no interrupt comes between a descriptor and where it is kept.
        fds.extend(map(os.open, [path], [os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK]))
        yield fds[0]
    finally:
        any(closing)


def encoded(text: Any) -> Optional[bytes]:
    """A text for C; None stays NULL."""
    if text is None:
        return None
    raw = os.fsencode(text) if isinstance(text, (str, bytes, os.PathLike)) else str(text).encode()
    if b"\0" in raw:
        raise UsageError("a text has a zero byte in it: %r" % (text,))
    return raw


def decoded(raw: Optional[bytes]) -> str:
    return raw.decode(errors="replace") if raw else ""
