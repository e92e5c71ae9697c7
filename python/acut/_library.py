"""libacut by ctypes: found, checked, and called in a way that loses no exception.

A Python function that C calls cannot raise: ctypes prints what comes out of it and goes on. A signal's handler (that of
Ctrl-C raises KeyboardInterrupt) runs where the interpreter next looks, and while C waits that is the first instruction of
just such a function, before any `try` in it. Therefore C never calls a function of Python here but the `send` of a
generator that waits inside of its `try` (guard). What it catches is kept, makes the call end as soon as C asks, and is
raised when the call has come back (State.ask).

Neither is there a lock that an interrupt could leave taken, between its being taken and the `try`, or before it is given
back. Who uses a connection does so within a generator, and has it as long as the frame of that runs (State.turn).
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
    """libacut.so.0, or what ACUT_LIBRARY names; loaded when it is first needed."""
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
        self.turns: List[Any] = []  # weak references, in the order in which they came; what is over goes with the next
        self.error: Optional[BaseException] = None
        self.keep: list = []  # what C has the address of
        self.fetch: Any = None  # a weak reference to the Fetch that C has, or has had last

    def fail(self, error: BaseException) -> None:
        if self.error is None:
            self.error = error

    def interrupted(self, ctx: int) -> bool:
        return self.error is not None

    def turn(self, work: Callable[[], T], refused: Callable[[], T]) -> T:
        """work() if no other turn goes on, else refused(). A turn goes on in another thread, or further up in this one: around
        a callback, or what the collector calls."""
        mine = _turn(self.turns, work, refused)
        next(mine)  # up to where it hears of itself
        answer, stop = mine.send(weakref.ref(mine))
        if stop is not None:
            raise stop
        return answer

    def alone(self, work: Callable[[], T], fetch: Any = None) -> T:
        """work() as one call on the connection: one thread at a time, and none while a callback runs or a fetch other than
        `fetch` goes on."""
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
        """Calls it on the connection. What a callback has raised is raised; so is the failure of the call."""
        return self.alone(lambda: self.ask(function, self.handle, *arguments))

    def ask(self, function: Callable[..., int], *arguments: Any) -> int:
        """The same for whose turn it is; `arguments` are all."""
        try:
            r = function(*arguments) if self.error is None else 0  # else it came while a callback was made ready
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
    """A turn goes on while its frame runs (gi_running), which ends with it however it is left, also by an interrupt at any
    instruction: there is nothing to be given back. The first of those that run has the connection."""
    me = yield
    turns.append(me)
    for other in tuple(turns):
        if other is me:
            del turns[:turns.index(me)]  # all of these are over; nobody else takes any away while this one runs
            break
        running = other()
        if running is not None and running.gi_running:
            work = refused
            break
    running = None
    try:
        answer = work(), None
    except StopIteration as e:  # of a callback: a generator cannot raise it
        answer = None, e
    yield answer


def _in_use() -> Any:
    raise UsageError("this connection is in use, by another thread or by the call that this callback belongs to",
                     hint="open a connection for each thread")


def close(state: State) -> None:
    """Of a connection that nobody uses any more; a second time does no harm."""
    # One call, and all of it in C: no interrupt comes between the end of what the handle is of and the handle's.
    any(map(functools.partial(setattr, state.handle, "value"), map(library().acut_close, [state.handle])))
    state.keep.clear()
    state.fetch = None


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
