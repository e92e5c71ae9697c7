"""The connection: the commands of acutctl as methods."""
import contextlib
import ctypes
import dataclasses
import functools
import grp
import os
import pwd
import weakref
from typing import Any, Callable, Iterable, Iterator, List, Optional, TypeVar, Union

from . import _abi as abi
from . import _library
from . import _results as results
from ._backup import BackupFile, FileGiver, Giver, backup_sink
from ._errors import InputError, UsageError, from_failure
from ._library import State, decoded, encoded, guard
from ._mesh import Fetch, Mesh, progress_function
from ._push import Push, push_options
from ._results import take
from ._view import Area, bound_notes, view_text, window_text
from ._volume import Volumes, volumes

SYSTEM_SOCKET = "/run/acut/acutd.sock"

T = TypeVar("T")
Path = Union[str, "os.PathLike[str]"]
JobOrId = Union[int, results.Job]
OnProgress = Optional[Callable[[results.Progress], None]]


def connect(socket: Optional[Path] = None, *, program: str = "python3-acut", timeout: float = 0) -> "Connection":
    """A connection to acutd: at `socket`, else at $ACUT_SOCKET, else at /run/acut/acutd.sock.

    with acut.connect() as server:
        print(server.ping())

    program  what the daemon's log calls this program
    timeout  seconds without a sign of life while a call waits, before it raises TimedOutError; 0: for ever
    """
    return Connection(socket, program=program, timeout=timeout)


class Connection:
    """A connection to acutd (see connect). Close it, or use it as a context manager; dropped, it is closed as well.

    One thread at a time: give each thread a connection of its own; a call while another one runs raises UsageError. Calls
    wait for the answer and can be interrupted by Ctrl-C. What a progress function raises ends the call and is raised by
    it; the connection can be used on. Failures are exceptions below acut.Error.
    """

    def __init__(self, socket: Optional[Path] = None, *, program: str = "python3-acut", timeout: float = 0) -> None:
        path = socket or os.environ.get("ACUT_SOCKET") or SYSTEM_SOCKET
        lib = _library.library()
        self.socket, self._program, self._timeout = os.fspath(path), program, float(timeout)
        self._state = state = State()
        options = abi.acut_options(encoded(program), self._timeout)
        options.interrupted = dict(abi.acut_options._fields_)["interrupted"](guard(state, state.interrupted, 1))
        state.keep.append(options)
        self._closed = weakref.finalize(self, _library.close, state)
        try:
            state.ask(lib.acut_connect, encoded(path), ctypes.byref(options), ctypes.byref(state.handle))
        except BaseException:
            self.close()
            raise

    # ---- itself ----

    def close(self) -> None:
        """Closes it; calling it again is harmless. Jobs continue, except those that are bound to it."""
        self._state.turn(functools.partial(_library.close, self._state), _goes_on)
        self._closed.detach()

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        return "<acut.Connection %s%s>" % (self.socket, "" if self._state.handle else ", closed")

    def fileno(self) -> int:
        """The socket, to poll for reading between calls."""
        return self._state.alone(lambda: _library.library().acut_fd(self._state.handle))

    @property
    def daemon_build(self) -> str:
        """The build id of the daemon."""
        return self._state.alone(lambda: decoded(_library.library().acut_daemon_build(self._state.handle)))

    def ping(self) -> float:
        """Seconds until an answer."""
        seconds = ctypes.c_double()
        self._call("ping", ctypes.byref(seconds))
        return seconds.value

    def status(self) -> results.Status:
        """The daemon: version, memory, threads, jobs, disk."""
        return self._ask("status", abi.acut_status, convert=results.status)

    def config(self) -> List[results.Setting]:
        """The daemon's settings, and the source of each."""
        return self._list("config", abi.acut_setting, convert=functools.partial(take, results.Setting))

    def metrics(self) -> List[results.Metric]:
        """The samples that acutctl metrics prints, see acut-metrics(7)."""
        return self._list("metrics", abi.acut_metric, convert=results.metric)

    def doctor(self) -> List[results.Check]:
        """The checks of the daemon's side; acutctl doctor also checks this side."""
        return self._list("doctor", abi.acut_check, convert=functools.partial(take, results.Check))

    # ---- how calls are made ----

    def _call(self, name: str, *arguments: Any) -> None:
        self._state.call(getattr(_library.library(), "acut_" + name), *arguments)

    def _ask(self, name: str, struct: Any, *arguments: Any, convert: Callable[[Any], T]) -> T:
        """Calls a function whose answer is a pointer that is valid until the next call."""
        ret = ctypes.POINTER(struct)()
        return self._answer(name, ret, arguments, lambda: convert(ret.contents))

    def _read(self, name: str, struct: Any, decimal_comma: bool, *arguments: Any, convert: Callable[[Any], T]) -> T:
        """Calls a function that reads a file, with options for decimal commas."""
        lib, state, ret = _library.library(), self._state, ctypes.POINTER(struct)()

        def work() -> T:
            state.ask(lib.acut_decimal_comma, state.handle, decimal_comma)
            state.ask(getattr(lib, "acut_" + name), state.handle, *arguments, ctypes.byref(ret))
            return convert(ret.contents)
        return state.alone(work)

    def _fill(self, name: str, struct: Any, *arguments: Any, convert: Callable[[Any], T]) -> T:
        """Calls a function that fills a struct of the caller."""
        ret = struct()
        return self._answer(name, ret, arguments, lambda: convert(ret))

    def _answer(self, name: str, ret: Any, arguments: Iterable[Any], converted: Callable[[], T]) -> T:
        def work() -> T:
            self._state.ask(getattr(_library.library(), "acut_" + name), self._state.handle, *arguments, ctypes.byref(ret))
            return converted()
        return self._state.alone(work)

    def _list(self, name: str, struct: Any, *arguments: Any, convert: Callable[[Any], T]) -> List[T]:
        """Calls a function that calls back for each row."""
        found: List[T] = []
        each = abi.acut_progress_fn(
            guard(self._state, lambda ctx, at: found.append(convert(struct.from_address(at))), 2))
        self._call(name, *arguments, each, None)
        return found

    # ---- datasets ----

    def datasets(self, *, removed: bool = False) -> List[results.Dataset]:
        """All datasets, sorted by name; or the removed ones that can be restored."""
        convert = functools.partial(take, results.Dataset)
        if removed:
            return self._list("datasets_removed", abi.acut_dataset, convert=convert)
        return self._list("datasets", abi.acut_dataset, None, convert=convert)

    def dataset(self, name: str, *, at: int = 0) -> results.Dataset:
        """One dataset, now or as of a generation. NotFoundError: there is none."""
        return self._fill("dataset_at", abi.acut_dataset, encoded(name), at, convert=functools.partial(take, results.Dataset))

    def create_dataset(self, name: str, *, scale: Any = None, crs: Optional[str] = None,
                       mode: Union[str, int, None] = None) -> None:
        """A dataset before its first push. scale: "0.01" or "0.01,0.001"; crs: "EPSG:n", a WKT, or a name; mode: as in push."""
        xy, _, z = str(scale).partition(",") if scale is not None else (None, None, None)
        with contextlib.ExitStack() as stack:
            # On a connection of its own where a mode is said: libacut keeps it for all that the connection makes.
            on = self if mode is None else stack.enter_context(Connection(self.socket, program=self._program,
                                                                          timeout=self._timeout))
            if mode is not None:
                on._call("dataset_mode", _mode(mode))
            on._call("dataset_create", encoded(name), encoded(xy), encoded(z or None), encoded(crs))

    def dataset_log(self, name: str, *, files: bool = False) -> List[results.Generation]:
        """The generations of a dataset, oldest first; with `files` also what each added and removed, as `changes`."""
        found: List[Any] = []
        changes: List[Any] = []

        def generation(ctx: int, at: int) -> None:
            nonlocal changes
            changes = []
            found.append(take(results.Generation, abi.acut_generation.from_address(at), changes=changes))

        def file(ctx: int, at: int) -> None:
            changes.append(take(results.LogFile, abi.acut_log_file.from_address(at)))

        sink, kinds = abi.acut_log_sink(), dict(abi.acut_log_sink._fields_)
        sink.generation = kinds["generation"](guard(self._state, generation, 2))
        if files:
            sink.file = kinds["file"](guard(self._state, file, 2))
        self._call("dataset_log", encoded(name), ctypes.byref(sink))
        return found

    def line_places(self, name: str, *, at: int = 0) -> List[results.LinePlace]:
        """Where lines of a dataset cross, and where their vertices have different heights; as of a generation, if it is given."""
        return self._list("line_places", abi.acut_line_place, encoded(name), at, convert=functools.partial(take, results.LinePlace))

    def _change(self, verb: str, name: str, id: int = 0, new: Optional[str] = None) -> results.Dataset:
        return self._fill("dataset_change", abi.acut_dataset, encoded(verb), encoded(name), id, encoded(new),
                          convert=functools.partial(take, results.Dataset))

    def remove_dataset(self, name: str) -> results.Dataset:
        """Removes a dataset; it can be restored until the time `until` of the result."""
        return self._change("remove", name)

    def restore_dataset(self, name: str, *, as_: Optional[str] = None) -> results.Dataset:
        """Restores a removed dataset, by name or by number (as a text), under the name `as_` if it is given."""
        return self._change("restore", name, int(name) if name.isdigit() else 0, as_)

    def pin_dataset(self, name: str) -> results.Dataset:
        """Protects a dataset from removal and pruning."""
        return self._change("pin", name)

    def unpin_dataset(self, name: str) -> results.Dataset:
        """Ends the protection."""
        return self._change("unpin", name)

    def chmod_dataset(self, name: str, mode: Union[str, int]) -> results.Dataset:
        """Sets who may read it and push into it: 0o640, "640", "g+w,o=". For its owner and administrators."""
        return self._fill("dataset_chmod", abi.acut_dataset, encoded(name), _mode(mode),
                          convert=functools.partial(take, results.Dataset))

    def chgrp_dataset(self, name: str, group: Union[str, int]) -> results.Dataset:
        """Sets the group, by name or number, to one that its owner is in; administrators may set any."""
        return self._fill("dataset_chgrp", abi.acut_dataset, encoded(name), _number("group", group),
                          convert=functools.partial(take, results.Dataset))

    def chown_dataset(self, name: str, user: Union[str, int]) -> results.Dataset:
        """Sets the owner, by name or number. For administrators."""
        return self._fill("dataset_chown", abi.acut_dataset, encoded(name), _number("user", user),
                          convert=functools.partial(take, results.Dataset))

    def revert(self, dataset: str, generation: int = 0) -> results.Reverted:
        """Undoes one generation, by default the newest, by a new generation."""
        return self._fill("dataset_revert", abi.acut_reverted, encoded(dataset), generation,
                          convert=functools.partial(take, results.Reverted))

    def prune(self, dataset: str, *, keep: int = 0, before: int = 0) -> results.Pruned:
        """Removes all generations but the newest `keep`, or all before generation `before`."""
        return self._fill("dataset_prune", abi.acut_pruned, encoded(dataset), keep, before,
                          convert=functools.partial(take, results.Pruned))

    def discard(self, dataset: str, *, all: bool = False) -> results.Discarded:
        """Removes what interrupted pushes of this user left; with `all` that of all users, for owner and administrators."""
        return self._fill("dataset_discard", abi.acut_discarded, encoded(dataset), int(all),
                          convert=lambda d: take(results.Discarded, d, open=[d.open[i] for i in range(d.nopen)]))

    def push(self, dataset: str, inputs: Any, *, scale: Any = None, format: Optional[str] = None,
             columns: Optional[str] = None, decimal_comma: bool = False, assume_crs: Optional[str] = None, assume_units: Optional[str] = None,
             override_crs: Optional[str] = None, override_units: Optional[str] = None,
             utm: Optional[str] = None, geoid: Optional[str] = None, geoid_way: Optional[str] = None, planar: bool = False,
             accept_truncated: bool = False, strict: bool = False, checksum: bool = False, add: bool = False,
             replace: bool = False, replaces: Optional[str] = None, mode: Union[str, int, None] = None,
             progress: OnProgress = None) -> results.Pushed:
        """Files into a dataset, which comes to be with its first push; visible all at once, with the commit.

        inputs   a path, an open binary file, a descriptor or acut.Lines, or several of them. Files are opened here, with the
                 rights of this program. What cannot be sought (a pipe, an io.BytesIO) is copied from a thread.
        strict   one refused input refuses all; else refused ones are in the result's `refused`, and only when there is
                 no good one its error is raised
        progress called with a Progress now and then
        mode     of a dataset that comes to be: 0o640, "640", "g+w"; unset: what the umask leaves of 666
        The others are the options of acutctl push. A push that breaks off keeps what it has on the daemon's disk: the
        same push again goes on with it.
        """
        if add and (replace or replaces):
            raise UsageError("add takes a file beside the old one, replace in its place: both at once are nothing")
        many = isinstance(inputs, Iterable) and not isinstance(inputs, (str, bytes)) and not hasattr(inputs, "read")
        inputs = list(inputs) if many else [inputs]
        if not inputs:
            raise UsageError("there is no input to push")
        if replaces is not None and len(inputs) != 1:
            raise UsageError("replaces is about one input, there are %d" % len(inputs))

        def work() -> results.Pushed:
            # On a connection of its own, which ends with it: what broke off is then for the next push to take up, at once.
            with Connection(self.socket, program=self._program, timeout=self._timeout) as own:
                if mode is not None:
                    own._call("dataset_mode", _mode(mode))
                own._call("decimal_comma", decimal_comma)
                options = push_options(own._state, dataset, scale, assume_units, progress, override_units=override_units,
                                       override_crs=override_crs, format=format, columns=columns,
                                       assume_crs=assume_crs, utm=utm, geoid=geoid, geoid_way=geoid_way, planar=planar,
                                       accept_truncated=accept_truncated, checksum=checksum, add=add, replace=replace,
                                       replaces=replaces, strict=strict)
                return Push(own._state, inputs, strict, options).run()
        return self._state.alone(work)

    def info(self, file: Any, *, format: Optional[str] = None, columns: Optional[str] = None,
             decimal_comma: bool = False) -> results.Info:
        """Reads the header of a file; `file` is a path or an open file."""
        with _opened(file) as (fd, name):
            return self._read("info", abi.acut_probe, decimal_comma, fd, name, encoded(format), encoded(columns),
                              convert=functools.partial(take, results.Info))

    def inspect(self, file: Any, *, format: Optional[str] = None, columns: Optional[str] = None,
                decimal_comma: bool = False) -> results.Inspected:
        """Reads all records of a file."""
        with _opened(file) as (fd, name):
            return self._read("inspect", abi.acut_inspected, decimal_comma, fd, name, encoded(format), encoded(columns),
                              convert=results.inspected)

    # ---- jobs ----

    def submit(self, dataset: str, *, at: int = 0, priority: Optional[str] = None, new: bool = False, bound: bool = False,
               view: Optional[str] = None, **words: Any) -> results.Job:
        """A job that meshes a dataset, which outlives this connection; the same job as before, if there is one.

        at        of this generation, not the newest
        priority  "low", "normal" or "high"
        new       a job of its own, even if there is the same already
        bound     it ends with this connection
        words     the view, in the words of acut.view_text: server.submit("valley", ground=True, crop=(0, 0, 500, 500))
        view      its text instead, as Job.view has it
        """
        what = abi.acut_submission(encoded(dataset), at, _view(view, words), encoded(priority), bound, new)
        job = self._ask("submit_job", abi.acut_job, ctypes.byref(what), convert=results.job)
        bound_of = words.get("max_error")
        return job if bound_of is None else dataclasses.replace(job, notes=bound_notes(bound_of, job.lattice, job.unit_z))

    def wait(self, job: JobOrId, *, changed: Optional[Callable[[results.Job], None]] = None,
             check: bool = True) -> results.Job:
        """Waits until the job is over, and returns it. A failed one raises its error, unless check is False. changed: called at
        each change."""
        return self._wait(job, True, changed, check)

    def job(self, job: JobOrId) -> results.Job:
        """The present state of a job."""
        return self._wait(job, False, None, False)

    def _wait(self, job: JobOrId, follow: bool, changed: Any, check: bool) -> results.Job:
        kind = abi.acut_progress_fn
        call = kind() if changed is None else kind(
            guard(self._state, lambda ctx, at: changed(results.job(abi.acut_job.from_address(at))) and None, 2))
        found = self._ask("job_wait", abi.acut_job, _id(job), follow, call, None, convert=results.job)
        if check and found.error is not None:
            raise found.error
        return found

    def jobs(self) -> List[results.Job]:
        """All jobs that this user may see."""
        return self._list("jobs", abi.acut_job, convert=results.job)

    def cancel(self, job: JobOrId) -> results.Job:
        """Ends a job that is not done."""
        return self._ask("job_cancel", abi.acut_job, _id(job), convert=results.job)

    def remove_job(self, job: JobOrId) -> None:
        """Removes a job that is over."""
        self._call("job_remove", _id(job))

    def plan(self, dataset: str, *, at: int = 0, view: Optional[str] = None, **words: Any) -> results.Plan:
        """Domains, memory, disk and time of a job; starts nothing. The words are those of submit."""
        plan = self._ask("plan", abi.acut_plan, encoded(dataset), at, _view(view, words),
                         convert=functools.partial(take, results.Plan))
        bound_of = words.get("max_error")
        if bound_of is None:
            return plan
        of = self.dataset(dataset, at=at)
        return dataclasses.replace(plan, notes=bound_notes(bound_of, of.lattice, of.unit_z))

    # ---- meshes ----

    def fetch(self, job: JobOrId = 0, *, since: int = 0, bbox: Any = None, polygon: Optional[Area] = None,
              resume: Optional[bytes] = None, progress: OnProgress = None) -> Fetch:
        """The mesh of a job as an iterator of blocks, also while the job runs.

        since    only what differs from the mesh of that generation (see Fetch.base and Fetch.gone)
        bbox, polygon  only the triangles that meet this area
        resume   goes on where Fetch.state() of an earlier fetch was taken; then no job is said
        progress called with a Progress while the job runs
        """
        area = window_text(bbox, polygon)
        self._call("fetch_window", encoded(area))
        return Fetch(self._state, _id(job), since, resume, progress)

    def mesh(self, job: JobOrId, *, bbox: Any = None, polygon: Optional[Area] = None, progress: OnProgress = None) -> Mesh:
        """Waits for the whole mesh of a job, and returns it in memory."""
        fetch = self.fetch(job, bbox=bbox, polygon=polygon, progress=progress)
        try:
            return Mesh(fetch)
        finally:
            fetch._over = True  # also if an interrupt keeps the next line from it: nobody else could end it
            fetch.close()

    def volume(self, first: JobOrId, second: Optional[JobOrId] = None, *, level: Any = None, within: Any = None,
               name_field: Optional[str] = None, unit: Optional[str] = None, output: Union[Path, Iterable[Path], None] = None,
               cell: Any = None, no_clobber: bool = False) -> Volumes:
        """Cut and fill between the meshes of two jobs, or between a level and that of one; waits until they are made.

        for v in server.volume(before, after, within="parcels.geojson"):
            print(v.name, v.fill, v.cut, "m3")

        level    a height in the unit of the mesh (a number, or a text with its exact digits), in place of the first surface
        within   polygons, a result for each: the path of a file of GeoJSON or WKT, GeoJSON as a mapping, an object with
                 __geo_interface__ (of shapely, geopandas), or an iterable of these
        name_field  the property that names a result: "name" if it is not given
        unit     of the results: "m", "ft", "ftUS" or "yd"; else that of the meshes
        output   images of the difference, .png or .tif; `cell` is the side of a pixel, a number or a text as "1m"
        It runs acutctl, which must be there: in PATH, or where ACUTCTL says.
        """
        jobs = [_id(j) for j in (first, second) if j is not None]

        def work() -> Volumes:
            return volumes(self.socket, os.environ.get("ACUTCTL") or "acutctl", jobs, level=level, within=within,
                           name_field=name_field, unit=unit, output=output, cell=cell, no_clobber=no_clobber)
        return self._state.alone(work)

    # ---- geoid grids, disk, backups ----

    def geoids(self) -> List[results.Geoid]:
        """The geoid grids that the daemon keeps, sorted by name."""
        return self._list("geoids", abi.acut_geoid, convert=functools.partial(take, results.Geoid))

    def add_geoid(self, file: Any, *, name: Optional[str] = None) -> results.Geoid:
        """Adds a checked copy of a PGM file of GeographicLib, under `name` or its own name without the ending."""
        with _opened(file) as (fd, text):
            stem = os.path.splitext(os.path.basename(os.fsdecode(text)))[0]
            return self._ask("geoid_add", abi.acut_geoid, fd, encoded(name or stem), text,
                             convert=functools.partial(take, results.Geoid))

    def remove_geoid(self, name: str) -> None:
        """Removes a grid."""
        self._call("geoid_remove", encoded(name))

    def cache_stat(self) -> results.CacheStat:
        """The use of the daemon's disk."""
        return self._ask("cache_stat", abi.acut_cache_stat, convert=results.cache_stat)

    def cache_verify(self, *, progress: OnProgress = None) -> results.Verified:
        """Reads all files that the daemon keeps; the result has the damaged ones."""
        damages: List[results.Damage] = []

        def damage(ctx: int, at: int) -> None:
            d = abi.acut_cache_damage.from_address(at)
            damages.append(take(results.Damage, d, error=from_failure(d.error)))

        each = abi.acut_progress_fn(guard(self._state, damage, 2))
        return self._fill("cache_verify", abi.acut_cache_verified, each, progress_function(self._state, progress), None,
                          convert=lambda s: take(results.Verified, s, damages=damages))

    def cache_adopt(self, packs: Iterable[Path], *, progress: OnProgress = None) -> results.Adopted:
        """Takes the finished domains of packs, files of the work folder of acut-cluster, into the daemon's cache. Administrators."""
        with contextlib.closing(FileGiver(self._state, [os.fspath(p) for p in packs])) as giver:
            return self._fill("cache_adopt", abi.acut_cache_adopted, giver.next, progress_function(self._state, progress), None,
                              convert=functools.partial(take, results.Adopted))

    def cache_gc(self, *, all: bool = False) -> int:
        """Frees disk space; with `all` everything that can be made again is removed. Returns the number of bytes."""
        gone, entries = ctypes.c_uint64(), ctypes.c_uint64()
        self._call("cache_gc", all, ctypes.byref(gone), ctypes.byref(entries))
        return gone.value

    def backup(self, each: Callable[[BackupFile], Any], *, dataset: Optional[str] = None) -> None:
        """Calls each(file) for the files of all that was pushed, as of now; or of one dataset, "manifest" last.

        acutctl backup and acutctl dataset export keep folders of these; this is for who keeps them elsewhere.
        """
        self._call("backup", encoded(dataset), ctypes.byref(backup_sink(self._state, each)))

    def import_dataset(self, folder: Path, name: Optional[str] = None) -> results.Imported:
        """Imports a folder that acutctl dataset export has written, as a new dataset; named after it, if no name is given."""
        folder = os.fspath(folder)
        with contextlib.closing(Giver(self._state, folder)) as giver:
            return self._ask("import", abi.acut_imported, encoded(name or os.path.basename(os.path.abspath(folder))),
                             giver.next, None, convert=functools.partial(take, results.Imported))


def _goes_on() -> None:
    raise UsageError("a call goes on on this connection, in another thread or around this callback")


def _id(job: JobOrId) -> int:
    return job.id if isinstance(job, results.Job) else int(job)


def _mode(mode: Union[str, int]) -> Optional[bytes]:
    """As libacut reads it: digits are octal, so a number is formatted as octal."""
    if isinstance(mode, int) and not isinstance(mode, bool):
        if not 0 <= mode <= 0o7777:
            raise UsageError("%s is not a mode" % oct(mode), hint="give it as 0o640 or \"640\"")
        return b"%04o" % mode
    return encoded(mode)


def _number(kind: str, who: Union[str, int]) -> int:
    """The number of a user or group of this machine; digits that are not a name are a number."""
    if isinstance(who, str):
        try:
            return pwd.getpwnam(who).pw_uid if kind == "user" else grp.getgrnam(who).gr_gid
        except KeyError:
            if not (who.isascii() and who.isdigit()):
                raise UsageError("there is no %s \"%s\"" % (kind, who)) from None
    number = int(who)
    if not 0 <= number < 2 ** 32 - 1:
        raise UsageError("%d is no number of a %s" % (number, kind))
    return number


def _view(text: Optional[str], words: Any) -> Optional[bytes]:
    if text is not None and words:
        raise UsageError("a view is said by its text or by its words, not by both")
    return encoded(text if text is not None else view_text(**words))


@contextlib.contextmanager
def _opened(file: Any) -> Iterator[Any]:
    """(descriptor, name) of a path or an open file."""
    if hasattr(file, "fileno"):
        yield file.fileno(), encoded(str(getattr(file, "name", "file")))
        return
    with contextlib.ExitStack() as stack:
        try:
            fd = stack.enter_context(_library.opened(file))
        except OSError as e:
            raise InputError("it cannot be opened: %s" % e.strerror, file=os.fsdecode(file)) from e
        yield fd, encoded(file)
