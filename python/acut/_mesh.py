"""Meshes: an iterator of blocks over acut_fetch_step, and whole arrays.

Arrays are memoryviews with a shape: `numpy.asarray(block.coordinates)` copies nothing, `.tolist()` needs no numpy. What
libacut read is copied once, as bytes, since its memory goes with the next block.
"""
import ctypes
import functools
import json
import struct
import weakref
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Optional, Tuple

from . import _abi as abi
from . import _library
from ._library import State, UsageError, decoded, guard
from ._results import Progress, take

_EMPTY = {"i": ctypes.c_int32, "I": ctypes.c_uint32, "Q": ctypes.c_uint64, "d": ctypes.c_double}


def _array(data: Any, kind: str, columns: int = 3) -> memoryview:
    size = ctypes.sizeof(_EMPTY[kind])
    rows = len(data) // (size * columns)
    if not rows:
        return memoryview(((_EMPTY[kind] * columns) * 0)())
    return memoryview(data).cast("B").cast(kind, [rows, columns])


def _address(data: bytes) -> Any:
    return ctypes.cast(ctypes.c_char_p(data), ctypes.c_void_p)


def _room(size: int) -> Tuple[bytearray, Any]:
    data = bytearray(size)
    return data, (ctypes.c_char * size).from_buffer(data)


class Head:
    """Properties of a mesh that are known before its first block. coordinate = (number + k) * scale."""

    def __init__(self, struct: Any) -> None:
        self._struct = abi.acut_mesh_head.from_buffer_copy(struct)
        self.lattice, self.scale_xy, self.scale_z = decoded(struct.lattice), decoded(struct.scale_xy), decoded(struct.scale_z)
        self.crs, self.unit_xy, self.unit_z = decoded(struct.crs), decoded(struct.unit_xy), decoded(struct.unit_z)
        # EPSG numbers of x and y and of heights (0: not known), the system of heights ("EPSG:5720", a name), the whole system as
        # WKT, the grid that converted the heights ("WAY HASH NAME"); "": none
        self.epsg, self.epsg_z, self.vertical = struct.epsg, struct.epsg_z, decoded(struct.vertical)
        self.wkt, self.geoid = decoded(struct.wkt), decoded(struct.geoid)
        # It has breaklines, shores, boundaries or holes, so flags may say which sides are; it ends at boundaries or holes
        self.lines, self.bounded = struct.lines, struct.bounded
        self.view, self.stream_id = decoded(struct.view), decoded(struct.stream_id)
        self.k: Tuple[int, int, int] = tuple(struct.k)
        self.box: Tuple[int, ...] = tuple(struct.box)  # of all vertices, in lattice numbers: min x y z, max x y z

    def coordinate(self, axis: int, number: int) -> float:
        """The nearest double; axis 0 x, 1 y, 2 z."""
        return _library.library().acut_coordinate(ctypes.byref(self._struct), axis, number)

    def coordinate_text(self, axis: int, number: int) -> str:
        """The coordinate as an exact decimal."""
        buffer = ctypes.create_string_buffer(48)
        return decoded(_library.library().acut_coordinate_text(ctypes.byref(self._struct), axis, number, buffer))


class Block:
    """Triangles of one region, with the vertices that come with it.

    index, region   of its domain, whose border is in doubled lattice numbers: min x y, max x y
    first           number of its first vertex in the mesh
    """

    def __init__(self, struct: Any, head: Head) -> None:
        self.index, self.first, self.region = struct.index, struct.first, tuple(struct.box)
        self._head, n = head, struct.nforeign + struct.nnew
        self._struct = abi.acut_mesh_block.from_buffer_copy(struct)
        self._keep = {}
        for name, size in (("foreign", 8 * struct.nforeign), ("vertex", 12 * struct.nnew),
                           ("triangle", 12 * struct.ntriangle), ("final", (n + 7) // 8), ("flags", struct.ntriangle),
                           ("origin", 8 * struct.nnew)):
            at = getattr(struct, name)
            pointer = ctypes.cast(at, ctypes.c_void_p).value if at else None
            data = ctypes.string_at(pointer, size) if pointer else b""
            self._keep[name] = data
            kind = type(getattr(self._struct, name)) if name not in ("vertex", "triangle") else ctypes.c_void_p
            setattr(self._struct, name, ctypes.cast(_address(data), kind) if pointer else kind())
        self._coordinates: Optional[bytearray] = None
        self._triangles: Optional[bytearray] = None

    def __repr__(self) -> str:
        return "<acut.Block %d: %d vertices, %d triangles>" % (self.index, self._struct.nnew, self._struct.ntriangle)

    @property
    def vertices(self) -> memoryview:
        """int32, (n, 3): exact lattice numbers of the vertices that come with this block."""
        return _array(self._keep["vertex"], "i")

    @property
    def coordinates(self) -> memoryview:
        """float64, (n, 3): the same in the units of the files, each the nearest double."""
        if self._coordinates is None:
            data, at = _room(24 * self._struct.nnew)
            _library.library().acut_block_coordinates(ctypes.byref(self._head._struct), ctypes.byref(self._struct), at)
            self._coordinates = data
        return _array(self._coordinates, "d")

    @property
    def triangles(self) -> memoryview:
        """uint64, (m, 3): numbers of vertices, counted over the whole stream."""
        if self._triangles is None:
            data, at = _room(24 * self._struct.ntriangle)
            _library.library().acut_block_triangles(ctypes.byref(self._struct), at)
            self._triangles = data
        return _array(self._triangles, "Q")

    @property
    def local_triangles(self) -> memoryview:
        """uint32, (m, 3): numbers in this block: the foreign vertices first, then its own."""
        return _array(self._keep["triangle"], "I")

    @property
    def foreign(self) -> memoryview:
        """uint64: vertices of earlier blocks that its triangles use."""
        data = self._keep["foreign"]
        return memoryview(data).cast("Q")

    @property
    def flags(self) -> Optional[bytes]:
        """A byte a triangle, bit k: the side across from corner k is a piece of a line (a breakline, a shore). None: none is."""
        return self._keep["flags"] if self._struct.flags else None

    @property
    def origins(self) -> Optional[List[Tuple[int, int]]]:
        """Of a view with hidden: class and source of each vertex that comes with this block; source 0 is not known, others are as
        in the log of a dataset. None: of another view."""
        if not self._struct.origin:
            return None
        return [(cls, source) for source, cls in struct.iter_unpack("<IBxxx", self._keep["origin"])]

    @property
    def final(self) -> bytes:
        """A bit a vertex, foreign ones first, low bits first: set if no later block uses it."""
        return self._keep["final"]


@dataclass(frozen=True)
class Tail:
    """The end of a stream. Both digests were computed here and matched."""
    blocks: int
    vertices: int
    triangles: int
    hull: int
    box: Tuple[int, ...]
    digest: str
    vertex_digest: str
    report: Dict[str, Any]


@dataclass(frozen=True)
class Base:
    """The mesh that changes are relative to."""
    generation: int
    job: int
    old_digest: str
    old_vertex_digest: str
    digest: str         # of the mesh that it becomes, whole
    vertex_digest: str
    gone: int
    gone_triangles: int
    kept: int
    kept_triangles: int


@dataclass(frozen=True)
class Region:
    """A region that was removed."""
    box: Tuple[int, int, int, int]
    triangles: int
    digest: str


class Fetch:
    """The blocks of a mesh, as they come: iterate over it, once.

    with server.fetch(job) as blocks:
        for block in blocks:
            ...
        print(blocks.tail.digest)

    head   what is known before the first block (asked for, it waits for it)
    tail   None until all blocks were taken; only then the mesh is known to be whole
    base, gone  of changes: what they are against, and the regions that are gone; filled before the first block
    Leaving it early closes it; other calls on the connection wait until then (they raise UsageError).
    """

    def __init__(self, state: State, job: int, since: int, resume: Optional[bytes], progress: Any) -> None:
        self._state, self._pieces = state, []  # type: ignore[var-annotated]
        # _over: other calls may use the connection. _kept: it ended by itself; until there is one, state() still answers.
        self._over, self._kept = True, False
        self._head: Optional[Head] = None
        self.tail: Optional[Tail] = None
        self.base: Optional[Base] = None
        self.gone: List[Region] = []
        # Guarded functions hold what they fill, not this object: a fetch that is dropped is closed at once.
        got = self._got = {"head": None, "tail": None, "base": None, "gone": self.gone, "blocks": self._pieces}
        self._sink = _sink(state, got, progress)
        self._ref: Any = weakref.ref(self, functools.partial(_end, state))

        def begin() -> None:
            state.fetch = self._ref  # before C has it: what an interrupt then leaves there goes with this object
            state.ask(_library.library().acut_fetch_begin, state.handle, job, since, resume, len(resume or b""),
                      ctypes.byref(self._sink))
            self._over = False

        try:
            state.alone(begin)
        except BaseException:
            self._over = True
            raise

    def _step(self) -> bool:
        state = self._state
        try:
            more = state.alone(lambda: state.ask(_library.library().acut_fetch_step, state.handle) > 0, self)
            self.tail, self.base = self._got["tail"], self._got["base"]
            if not more:
                state.fetch = self._ref = weakref.ref(self)  # nothing is left to be done when it goes
        except BaseException:
            self._over = self._kept = True
            raise
        if not more:
            self._over = self._kept = True
        return more

    @property
    def head(self) -> Head:
        while self._got["head"] is None and not self._over and self._step():
            pass
        head = self._got["head"]
        if head is None:
            raise UsageError("this fetch was closed before its head came")
        return head

    def __iter__(self) -> Iterator[Block]:
        return self

    def __next__(self) -> Block:
        while not self._pieces:
            if self._over or not self._step():
                raise StopIteration
        piece = self._pieces[0]
        del self._pieces[0]  # not by a call, in which an interrupt could lose it
        return piece

    def state(self) -> bytes:
        """The state after the last block that was read, to continue this fetch later: for fetch(resume=...)."""
        if self._pieces:
            raise UsageError("a block has come that was not taken", hint="take it first, by next()")
        state, at, size = self._state, ctypes.c_void_p(), ctypes.c_size_t()
        try:
            state.alone(lambda: state.ask(_library.library().acut_fetch_state, state.handle, ctypes.byref(at),
                                          ctypes.byref(size)), self)
            return ctypes.string_at(at, size.value)
        finally:
            _free(at)

    def close(self, keep_state: bool = False) -> None:
        """Ends the fetch. `keep_state`: state() can be called until the next call."""
        if self._kept:
            return
        self._over, self._kept = True, keep_state
        if not keep_state:
            _end(self._state, self._ref)
            self._ref = None

    def __enter__(self) -> "Fetch":
        return self

    def __exit__(self, *exc: Any) -> None:
        self.close()


def _end(state: State, ref: Any) -> None:
    """Ends the fetch of this weak reference; the reference calls it when the fetch is dropped. Calling it again is harmless."""
    def work() -> None:
        if state.fetch is ref:
            if state.handle:
                _library.library().acut_fetch_end(state.handle)
            state.fetch = None
    if ref is not None and state.fetch is ref:
        state.turn(work, lambda: None)  # whoever has the turn ends it, or the next one does


def _sink(state: State, got: Dict[str, Any], progress: Any) -> Any:
    def head(ctx: int, at: int) -> None:
        got["head"] = Head(abi.acut_mesh_head.from_address(at))

    def block(ctx: int, at: int) -> None:
        got["blocks"].append(Block(abi.acut_mesh_block.from_address(at), got["head"]))

    def tail(ctx: int, at: int) -> None:
        s = abi.acut_mesh_tail.from_address(at)
        try:
            report = json.loads(decoded(s.report) or "{}")
        except ValueError:
            report = {}
        got["tail"] = take(Tail, s, report=report)

    def base(ctx: int, at: int) -> None:
        got["base"] = take(Base, abi.acut_mesh_base.from_address(at))

    def gone(ctx: int, at: int) -> None:
        got["gone"].append(take(Region, abi.acut_mesh_region.from_address(at)))

    sink = abi.acut_changes_sink()
    sink.mesh.head, sink.mesh.block, sink.mesh.tail = (
        _field(abi.acut_mesh_sink, name)(guard(state, f, 2)) for name, f in (("head", head), ("block", block), ("tail", tail)))
    sink.base, sink.gone = (
        _field(abi.acut_changes_sink, name)(guard(state, f, 2)) for name, f in (("base", base), ("gone", gone)))
    if progress is not None:
        sink.mesh.progress = progress_function(state, progress)
    return sink


def _field(struct: Any, name: str) -> Any:
    return dict(struct._fields_)[name]


def progress_function(state: State, progress: Any) -> Any:
    """A C function that calls progress(Progress(...)); NULL for None."""
    if progress is None:
        return _library.NO_LIST
    return abi.acut_progress_fn(
        guard(state, lambda ctx, at: progress(take(Progress, abi.acut_progress.from_address(at))) and None, 2))


_free = ctypes.CDLL(None).free
_free.argtypes, _free.restype = [ctypes.c_void_p], None


class Mesh:
    """A whole mesh in memory, checked against both of its digests.

    vertices     float64, (n, 3): coordinates in the units of the files, each the nearest double
    lattice      int32, (n, 3): the same vertices as exact lattice numbers (head.coordinate_text gives exact decimals)
    triangles    uint64, (m, 3): numbers of vertices, counterclockwise seen from above
    flags        a byte a triangle, bit k: the side across from corner k is a piece of a line; None: none is
    head, tail   what came before and after the blocks
    digest, vertex_digest
    """

    def __init__(self, fetch: Fetch) -> None:
        coordinates, lattice, triangles, flags = bytearray(), bytearray(), bytearray(), bytearray()
        with fetch:
            for block in fetch:
                coordinates += block.coordinates.cast("B") if len(block.coordinates) else b""
                lattice += block._keep["vertex"]
                triangles += block.triangles.cast("B") if len(block.triangles) else b""
                flags += block.flags or bytes(block._struct.ntriangle)
            self.head, tail = fetch.head, fetch.tail
        assert tail is not None
        self.tail: Tail = tail
        self.vertices, self.lattice = _array(coordinates, "d"), _array(lattice, "i")
        self.triangles = _array(triangles, "Q")
        self.flags: Optional[bytes] = bytes(flags) if any(flags) else None

    @property
    def digest(self) -> str:
        return self.tail.digest

    @property
    def vertex_digest(self) -> str:
        return self.tail.vertex_digest

    def __repr__(self) -> str:
        return "<acut.Mesh: %d vertices, %d triangles, digest %s>" % (len(self.vertices), len(self.triangles), self.digest)
