"""Loads libacut with ctypes, checks its version, and calls it so that no exception is lost.

A Python function that C calls cannot raise: ctypes prints the exception and goes on. A signal handler (that of Ctrl-C
raises KeyboardInterrupt) runs when the interpreter next checks for signals. While C waits, that is at the first instruction
of such a function, before any `try` in it. Therefore C only calls the `send` of a generator that waits within its `try`
(guard). The exception is stored, ends the call at the next callback, and is raised when the call has returned (State.ask).

A lock could stay locked after an interrupt, between locking and the `try`, or before unlocking. So there are no locks: a
connection is used within a generator, and is in use as long as the frame of the generator runs (State.turn).
"""
import contextlib
import ctypes
import functools
import os
import threading
import weakref
from typing import Any, Callable, Iterator, List, Optional, TypeVar

from . import _abi as abi
from ._errors import NoMemoryError, UsageError, VersionError, from_failure

T = TypeVar("T")

_lock = threading.Lock()
_library: Optional[ctypes.CDLL] = None


def library() -> ctypes.CDLL:
    """libacut.so.0, or the library that ACUT_LIBRARY names; loaded when it is first needed."""
    global _library
    if _library is None:
        with _lock:
            _library = _library or _load(os.environ.get("ACUT_LIBRARY") or "libacut.so.0")
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
    """A function that ctypes may call with `count` addresses. It returns 0, or another number to end the call."""
    return _collect(_guarded(state, function, count), count)


def _collect(generator, count):
    next(generator)
    if count == 1:
        return generator.send
    # max() passes the arguments to `send`, one after the other, without a Python instruction. It returns the argument with
    # the greatest answer, the first one if they are equal: 0 (the unused `ctx`), or the last address if its answer is 1.
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
            over = count > 1  # it may have come between two arguments, so later ones are incomplete


NO_LIST = abi.acut_progress_fn()  # a NULL of any function (void *, const struct ... *)


class State:
    """Shared by a connection and its callbacks. It has no reference to the connection: with a reference cycle the connection
    would not be closed before the garbage collector runs."""

    def __init__(self) -> None:
        self.handle = ctypes.c_void_p()
        self.turns: List[Any] = []  # weak references, in order; those that have ended are removed by the next turn
        self.error: Optional[BaseException] = None
        self.keep: list = []  # objects whose addresses C has
        self.fetch: Any = None  # a weak reference to the current or last Fetch

    def fail(self, error: BaseException) -> None:
        if self.error is None:
            self.error = error

    def interrupted(self, ctx: int) -> bool:
        return self.error is not None

    def turn(self, work: Callable[[], T], refused: Callable[[], T]) -> T:
        """work() if no other turn is running, else refused(). Another turn may run in another thread, or further up the stack
        of this one, which then is in a callback or in a finalizer."""
        mine = _turn(self.turns, work, refused)
        next(mine)  # up to the `yield` that gets the reference
        answer, stop = mine.send(weakref.ref(mine))
        if stop is not None:
            raise stop
        return answer

    def alone(self, work: Callable[[], T], fetch: Any = None) -> T:
        """work() as one call on the connection: only one thread at a time, and not while a callback runs or another fetch than
        `fetch` is open."""
        def checked() -> T:
            if not self.handle:
                raise UsageError("this connection is closed")
            last = self.fetch() if self.fetch else None
            if fetch is not None and last is not fetch:
                raise UsageError("there is no fetch to go on with")
            if last is not None and last is not fetch and not last._over:
                raise UsageError("a fetch goes on on this connection",
                                 hint="take all of its blocks, close it, or open a second connection")
            return work()
        return self.turn(checked, _in_use)

    def call(self, function: Callable[..., int], *arguments: Any) -> int:
        """Calls the function on the connection. Raises the exception of a callback, or the failure of the call."""
        return self.alone(lambda: self.ask(function, self.handle, *arguments))

    def ask(self, function: Callable[..., int], *arguments: Any) -> int:
        """The same within a turn; `arguments` are all arguments."""
        try:
            r = function(*arguments) if self.error is None else 0  # else an interrupt came while a callback was prepared
        finally:
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


def _turn(turns, work, refused):
    """A turn lasts as long as its frame runs (gi_running). The frame ends however it is left, also by an interrupt at any
    instruction, so there is nothing to release. The first of the running turns has the connection."""
    me = yield
    turns.append(me)
    for other in tuple(turns):
        if other is me:
            del turns[:turns.index(me)]  # all of these have ended; no other turn removes any while this one runs
            break
        running = other()
        if running is not None and running.gi_running:
            work = refused
            break
    running = None
    try:
        answer = work(), None
    except StopIteration as e:  # from a callback: a generator cannot raise it
        answer = None, e
    yield answer


def _in_use() -> Any:
    raise UsageError("this connection is in use, by another thread or by the call that this callback belongs to",
                     hint="open a connection for each thread")


def close(state: State) -> None:
    """Closes a connection that is not in use. May be called again."""
    # One call, all of it in C, so that no interrupt comes between acut_close and the reset of the handle.
    any(map(functools.partial(setattr, state.handle, "value"), map(library().acut_close, [state.handle])))
    state.keep.clear()
    state.fetch = None


@contextlib.contextmanager
def opened(path: Any) -> Iterator[int]:
    """A descriptor of a file to be read. It does not block, since a named pipe may have no writer."""
    fds: List[int] = []
    closing = map(os.close, fds)
    try:
        # One call in C, so that no interrupt comes between opening the descriptor and storing it.
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
