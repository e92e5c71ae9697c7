"""Volumes between meshes: numbers by polygon, as acutctl volume has them.

The comparison is the program's, which reads two streams of meshes in bounded memory; a second one in Python would have other
bounds and other errors. So it is run, and what it prints with --json is taken.
"""
import contextlib
import json
import os
import subprocess
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

from ._errors import CLASSES, Error, InternalError, UsageError
from ._lines import _is_mapping, _plain


@dataclass(frozen=True)
class Volume:
    """Of a whole comparison, or inside of one polygon. Volumes are in `unit_volume` of Volumes, areas in `unit_area`."""
    name: str           # of the polygon; "": it has none
    fill: float         # where the second surface is higher
    cut: float          # where it is lower
    net: float          # fill less cut
    error: float        # none of the three is wrong by more
    area: float         # of the plane that both cover
    fill_area: float
    cut_area: float
    same_area: float
    only_first: float   # that one covers alone
    only_second: float
    area_error: float   # `area` is not wrong by more


@dataclass(frozen=True)
class ComparedMesh:
    job: int
    dataset: str
    generation: int
    triangles: int      # that were compared: with polygons those that meet them
    digest: str         # of these
    vertex_digest: str


@dataclass(frozen=True)
class Volumes:
    """The result of a comparison: one Volume, or one for each polygon, in their order. Iterate over it, or take it by number."""
    meshes: List[ComparedMesh]
    level: Optional[float]
    unit_level: str           # "m", "ft", "ftUS"; "": there is no level
    unit_volume: str          # "m3", "ft3", "ftUS3", "yd3"
    unit_area: str            # "m2", "ft2", "ftUS2", "yd2"
    pairs: int                # of triangles with a common place
    volumes: List[Volume]
    outputs: List[str]
    color_range: Optional[float]
    unit_color_range: str
    warnings: List[str]

    def __iter__(self) -> Iterator[Volume]:
        return iter(self.volumes)

    def __len__(self) -> int:
        return len(self.volumes)

    def __getitem__(self, i: int) -> Volume:
        return self.volumes[i]


def _geometry(what: Any) -> Mapping[str, Any]:
    """GeoJSON without what is not JSON: tuples and numbers of arrays."""
    what = _plain(what)
    if not _is_mapping(what):
        raise UsageError("within is the path of a file of GeoJSON or WKT, GeoJSON as a mapping, or objects with polygons, not %r" % (what,))
    return what


def _document(within: Any) -> bytes:
    what = _plain(within)
    if not _is_mapping(what):
        if not hasattr(what, "__iter__"):
            _geometry(what)
        what = {"type": "FeatureCollection", "features": [
            f if f.get("type") == "Feature" else {"type": "Feature", "properties": {}, "geometry": f} for f in map(_geometry, what)]}
    elif what.get("type") == "FeatureCollection":
        what = {**what, "features": [_geometry(f) for f in what.get("features") or ()]}
    return json.dumps(what, default=_number).encode()


def _number(value: Any) -> Any:
    """Of what json does not know: arrays, numbers of numpy, Decimal as the nearest double."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "__geo_interface__"):
        return value.__geo_interface__
    try:
        return float(value)
    except (TypeError, ValueError):
        return str(value)


def _error(document: Mapping[str, Any], status: int) -> Error:
    e = document.get("error") or {}
    known = CLASSES.get(e.get("code", ""))
    error = (known or Error)(e.get("message") or "acutctl ended with %d" % status, file=e.get("file"), offset=e.get("offset"),
                             field=e.get("field"), hint=e.get("hint"))
    if not known:
        error.code, error.exit_status = e.get("code") or "internal", status
    return error


def _parse(out: str, status: int) -> Dict[str, Any]:
    lines = [line for line in out.splitlines() if line.strip()]
    try:
        document = json.loads(lines[-1]) if lines else {}
    except ValueError:
        document = {}
    if status or "volumes" not in document:
        raise _error(document, status)
    return document


def _take(cls: Any, found: Mapping[str, Any], **more: Any) -> Any:
    texts = ("name", "unit_level", "unit_color_range")
    given = {k: ("" if v is None and k in texts else v) for k, v in found.items() if k in cls.__dataclass_fields__}
    return cls(**{**given, **more})


@contextlib.contextmanager
def _file_of(within: Any) -> Iterator[Tuple[Optional[str], Tuple[int, ...]]]:
    """A path for acutctl, and the descriptors that it needs for it."""
    if within is None:
        yield None, ()
    elif isinstance(within, (str, os.PathLike)):
        yield os.fspath(within), ()
    else:
        with os.fdopen(os.memfd_create("acut-within", os.MFD_CLOEXEC), "r+b") as f:
            f.write(_document(within))
            f.flush()
            yield "/dev/fd/%d" % f.fileno(), (f.fileno(),)


def volumes(socket: str, program: str, jobs: List[int], *, level: Any, within: Any, name_field: Optional[str],
            unit: Optional[str], output: Any, cell: Any, no_clobber: bool) -> Volumes:
    words = [program, "volume", "--json", *map(str, jobs)]
    for name, value in (("level", level), ("name-field", name_field), ("unit", unit), ("cell", cell)):
        if value is not None:
            words.append("--%s=%s" % (name, value))
    outputs = [output] if isinstance(output, (str, os.PathLike)) else list(output or ())
    for one in outputs:
        words.append("--output=" + os.fspath(one))
    if no_clobber:
        words.append("--no-clobber")
    with _file_of(within) as (path, fds):
        if path is not None:
            words.append("--within=" + path)
        try:
            done = subprocess.run(words, env={**os.environ, "ACUT_SOCKET": socket}, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL, pass_fds=fds, check=False)
        except OSError as e:
            raise InternalError("%s cannot be run: %s" % (program, e.strerror),
                                hint="volumes need the program acutctl of the same release; ACUTCTL names it where it is not in PATH") from e
        try:
            found = _parse(done.stdout.decode(errors="replace"), done.returncode)
        except Error as e:
            if fds and e.file == path:
                e.file = "within"
            raise
    try:
        return _take(Volumes, found, meshes=[_take(ComparedMesh, m) for m in found["meshes"]],
                     volumes=[_take(Volume, v) for v in found["volumes"]])
    except (AttributeError, KeyError, TypeError) as e:
        raise InternalError("what %s says of volumes is not understood" % program,
                            hint="it is of another release: ACUTCTL names the program") from e
