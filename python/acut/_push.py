"""Pushing files into a dataset: all headers first, then the points, file by file, then the commit."""
import contextlib
import ctypes
import io
import os
import shutil
import stat
import threading
from typing import Any, Iterator, List, Optional, Tuple

from . import _abi as abi
from . import _library
from ._errors import (ChangedError, Error, InputError, LimitError, NotFoundError, NotPermittedError, ReadWriteError, TruncatedError,
                      UnsupportedError, UsageError)
from ._library import State, decoded, encoded
from ._lines import Lines
from ._mesh import progress_function
from ._results import LineSet, Pushed, PushedFile, take

# Failures of the file itself, not of the connection.
_REFUSALS = (InputError, TruncatedError, ChangedError, UnsupportedError, LimitError, NotPermittedError)


class _Input:
    """One input: a path that is opened when it is needed, an open file, or a pipe."""

    def __init__(self, what: Any) -> None:
        self.source, self.path, self.fd, self.result = what, None, -1, None  # type: Any, Optional[bytes], int, Any
        self.streamed, self.copier, self.failed = False, None, None  # type: bool, Any, Optional[BaseException]
        self.error: Optional[Error] = None
        if isinstance(what, (str, bytes, os.PathLike)):
            self.name = os.fsdecode(what)
            self.path = os.fsencode(os.path.abspath(os.fspath(what)))
            return
        self.name = getattr(what, "name", None)
        if isinstance(what, Lines):
            self.path = os.fsencode(what.path)
        try:
            self.fd = what if isinstance(what, int) and not isinstance(what, bool) else what.fileno()
        except (AttributeError, OSError, io.UnsupportedOperation):
            if not hasattr(what, "read"):
                raise UsageError("an input is a path, an open binary file or a descriptor, not %r" % (what,)) from None
        if self.fd >= 0:
            found = os.fstat(self.fd)
            self.streamed = not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode)
            if isinstance(self.name, str) and not self.path:
                with contextlib.suppress(OSError):
                    if os.path.samestat(os.stat(self.name), found) and not self.streamed:
                        self.path = os.fsencode(os.path.abspath(self.name))
        else:
            self.streamed = True
        if not isinstance(self.name, str):
            self.name = "descriptor %d" % self.fd if self.fd >= 0 else "stream"

    @contextlib.contextmanager
    def opened(self) -> Iterator[Any]:
        """The acut_push_input for libacut, with the file open."""
        fd = -1 if self.streamed else self.fd
        with contextlib.ExitStack() as stack:
            if fd < 0 and not self.streamed:
                try:
                    fd = stack.enter_context(_library.opened(self.source))
                except FileNotFoundError as e:
                    raise InputError("it cannot be opened: %s" % e.strerror, file=self.name) from None
                except PermissionError as e:
                    raise NotPermittedError("it cannot be opened: %s" % e.strerror, file=self.name) from None
                except OSError as e:
                    raise ReadWriteError("it cannot be opened: %s" % e.strerror, file=self.name) from None
            yield abi.acut_push_input(fd, encoded(self.name), self.path)

    def start(self, fd: int) -> None:
        """Copies into the daemon's pipe in a thread, which ends at the end of the input, or when the daemon closes the pipe."""
        def copy() -> None:
            with os.fdopen(fd, "wb") as out:
                try:
                    if hasattr(self.source, "read"):
                        shutil.copyfileobj(getattr(self.source, "buffer", self.source), out, 1 << 16)
                    else:
                        with os.fdopen(os.dup(self.fd), "rb") as source:
                            shutil.copyfileobj(source, out, 1 << 16)
                except BrokenPipeError:
                    pass
                except BaseException as e:  # raised by finish, in the caller's thread
                    self.failed = e
        self.copier = threading.Thread(target=copy, name="acut " + self.name, daemon=True)
        self.copier.start()

    def finish(self) -> None:
        if self.copier:
            self.copier.join()
        if self.failed:
            raise self.failed


class Push:
    """One push, from begin to commit."""

    def __init__(self, state: State, inputs: List[Any], strict: bool, options: Any) -> None:
        self.state, self.strict, self.options = state, strict, options
        self.lib, self.push = _library.library(), ctypes.c_void_p()
        self.inputs = [_Input(i) for i in inputs]

    def run(self) -> Pushed:
        ask, committed = self.state.ask, False
        ask(self.lib.acut_push_begin, self.state.handle, ctypes.byref(self.options), ctypes.byref(self.push))
        note = decoded(self.lib.acut_push_note(self.push))
        try:
            for i in self.inputs:
                if i.streamed:
                    fd = ctypes.c_int(-1)
                    ask(self.lib.acut_push_stream, self.push, encoded(i.name), ctypes.byref(fd))
                    i.start(fd.value)
            self._each(self._probe)
            if any(i.result is None and i.error is None for i in self.inputs):
                lattice = ctypes.c_char_p()
                ask(self.lib.acut_push_plan, self.push, ctypes.byref(lattice))
                planned = decoded(self.lib.acut_push_planned(self.push).contents.note)
                note = "; ".join(text for text in (note, planned) if text)
                self._each(self._stage)
            done = ctypes.POINTER(abi.acut_push_result)()
            ask(self.lib.acut_push_commit, self.push, ctypes.byref(done))
            committed = True
            result = done.contents
            lines = take(LineSet, result.line_set.contents) if result.line_set else None
            return take(Pushed, result, files=[i.result for i in self.inputs], note=note, line_set=lines)
        finally:
            # Complete files are kept for a repeated push, but not by a strict push or one without a name.
            if committed or (self.options.dataset and not self.strict):
                self.lib.acut_push_leave(self.push)
            else:
                # acut_push_end waits for an answer: an exception of a signal handler meanwhile must not be lost.
                ask(lambda: self.lib.acut_push_end(self.push) or 0)

    def _each(self, step: Any) -> None:
        for i in self.inputs:
            if i.result is not None:
                continue
            try:
                step(i)
            except Error as e:
                refusal = isinstance(e, _REFUSALS) and e.field != "push"  # of this input; else of the push, or the daemon
                if refusal and e.file is None:
                    e.file = i.name
                if self.strict or not refusal or isinstance(e, NotFoundError):
                    raise
                i.error, i.result = e, PushedFile(i.name, "refused", error=e)
        if self.inputs and all(i.error is not None for i in self.inputs):
            raise self.inputs[0].error  # all were refused: the first refusal is the failure

    def _probe(self, i: _Input) -> None:
        with i.opened() as what:
            p = ctypes.POINTER(abi.acut_probe)()
            self.state.ask(self.lib.acut_push_probe_input, self.push, ctypes.byref(what), ctypes.byref(p))
        probe = p.contents
        if probe.known:
            i.result = PushedFile(i.name, "known" if probe.known == abi.ACUT_KNOWN else "adopted", points=probe.points,
                                  replaced=probe.replaced, warning=decoded(probe.warning))

    def _stage(self, i: _Input) -> None:
        with i.opened() as what:
            f = ctypes.POINTER(abi.acut_file_result)()
            self.state.ask(self.lib.acut_push_file_input, self.push, ctypes.byref(what), ctypes.byref(f))
        i.result = take(PushedFile, f.contents, name=i.name, state="staged", error=None)
        i.finish()


def push_options(state: State, dataset: Optional[str], scale: Any, assume_units: Optional[str], progress: Any,
                 crop: Optional[Tuple[float, float, float, float]] = None, override_units: Optional[str] = None,
                 **more: Any) -> Any:
    options = abi.acut_push_options()
    options.dataset = encoded(dataset)
    for name, value in (("scale", scale), ("assume_unit", assume_units), ("override_unit", override_units)):
        if value is not None:
            xy, _, z = str(value).partition(",") if not isinstance(value, (tuple, list)) else (value[0], "", value[1])
            setattr(options, name + "_xy", encoded(str(xy)))
            setattr(options, name + "_z", encoded(str(z)) if z else None)
    for name, value in more.items():
        setattr(options, name, bool(value) if isinstance(value, bool) else encoded(value))
    options.progress = progress_function(state, progress)
    return options
