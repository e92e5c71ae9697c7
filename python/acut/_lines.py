"""Breaklines, lakes, boundaries and holes of Python as an input of a push: the text that acutd reads (docs/formats/lines.md)."""
import decimal
import hashlib
import math
import numbers
import os
import re
import weakref
from typing import Any, Iterable, Iterator, List, Optional, Tuple, Union

from ._errors import UsageError

KINDS = ("hard", "lake", "boundary", "hole")
_Ring = Tuple[bool, List[Tuple[str, str, str]]]


class Lines:
    """Lines for Connection.push, in place of a file: server.push("valley", [acut.Lines(roads, name="roads")]).

    features  what has lines: GeoJSON as a mapping (a FeatureCollection, a Feature, a geometry), an object with
              __geo_interface__ (of shapely, geopandas, fiona), a sequence or array of vertices (n, 3), or any iterable of these
    kind      "hard" (breaklines), "soft" (the same), "lake", "boundary" or "hole"
    kind_field  the property of features that has their kind; `kind` is then of those without it
    name      what the dataset calls it, and knows it by: the same lines again are skipped, others of this name need
              replace=True, or add=True
    crs       the coordinate system, as assume_crs takes it, or an object with to_wkt(); a dataset that has one asks for it
    units     "m", "ft" or "ftUS" (or as Dataset.unit_z has them), of x, y and z; "ft,m" of x and y, and of z. Where crs has that
              of x and y, that of z alone is taken
    densify   the longest segment, a number or a text with a unit, "5m"; lake_level: "min", "max" or "mean", as of acutctl

    Each vertex has x, y and z; degrees are longitude, latitude. Numbers keep all of their digits (int, float, Decimal). Polygons
    are rings. For a lake, boundary or hole an array is a ring, closed or not, and a LineString must be closed.
    The features are read at once, and kept as text in memory until this object goes.
    """

    def __init__(self, features: Any, *, kind: str = "hard", kind_field: Optional[str] = None, name: str = "lines", crs: Any = None,
                 units: Optional[str] = None, densify: Union[float, str, None] = None, lake_level: Optional[str] = None) -> None:
        self.name, self.features, self.vertices = name, 0, 0
        self._kind, self._kind_field = _kind(kind, "kind"), kind_field
        self._fd = os.memfd_create("acut-lines", os.MFD_CLOEXEC)
        self._close = weakref.finalize(self, os.close, self._fd)
        with os.fdopen(os.dup(self._fd), "w", encoding="utf-8", newline="\n") as out:
            out.writelines(row + "\n" for row in _head(crs, units, densify, lake_level))
            for found in _each(features):
                self.features += 1
                out.writelines(row + "\n" for row in self._rows(found))
        if not self.features:
            raise UsageError("there are no lines in it")
        # A dataset knows a file by path, size and time of change: those of the same text must be the same, and of no other text.
        self.path, digest = "python:" + name, hashlib.blake2b(digest_size=8)
        for at in range(0, os.fstat(self._fd).st_size, 1 << 20):
            digest.update(os.pread(self._fd, 1 << 20, at))
        time = int.from_bytes(digest.digest(), "little") >> 2
        os.utime(self._fd, ns=(time, time))

    def __repr__(self) -> str:
        return "<acut.Lines %s: %d features, %d vertices>" % (self.name, self.features, self.vertices)

    def fileno(self) -> int:
        """The text, as a file without a name."""
        return self._fd

    def _rows(self, found: Any) -> Iterator[str]:
        kind, geometry = self._kind, found
        try:
            if _is_mapping(found) and found.get("type") == "Feature":
                word = (found.get("properties") or {}).get(self._kind_field) if self._kind_field else None
                kind, geometry = _kind(word, "its kind") if word else kind, found.get("geometry")
            parts = list(_parts(geometry, kind != "hard"))
            if not parts:
                raise UsageError("it has no geometry")
            yield "feature %d %s" % (self.features, kind)
            for ring, vertices in parts:
                if len(vertices) < (3 if ring else 2):
                    raise UsageError("it is a %s of %d vertices" % ("ring" if ring else "line", len(vertices)))
                self.vertices += len(vertices)
                yield "ring" if ring else "line"
                yield from map(" ".join, vertices)
        except UsageError as e:
            raise UsageError("feature %d: %s" % (self.features, e.message), hint=e.hint) from None


def _is_mapping(what: Any) -> bool:
    return hasattr(what, "get") and hasattr(what, "keys")


def _plain(what: Any) -> Any:
    return what if _is_mapping(what) else getattr(what, "__geo_interface__", what)


def _each(features: Any) -> Iterator[Any]:
    """Features and geometries as mappings, and sequences of vertices."""
    what = _plain(features)
    if _is_mapping(what):
        if what.get("type") == "FeatureCollection":
            yield from map(_plain, what.get("features") or ())
        else:
            yield what
    elif getattr(what, "ndim", 0) == 2:  # an array of vertices
        yield what
    elif isinstance(what, (str, bytes)) or not isinstance(what, Iterable):
        raise UsageError("lines are features or vertices, not %r" % (what,), hint="files of lines are pushed by acutctl push --lines-as")
    else:
        what = list(what)
        if what and _is_vertex(what[0]):
            yield what
            return
        for one in what:
            yield from _each(one)


def _is_vertex(what: Any) -> bool:
    return getattr(what, "ndim", 0) == 1 or isinstance(what, (tuple, list)) and 0 < len(what) <= 4 and all(isinstance(v, (numbers.Number, decimal.Decimal)) for v in what)


def _parts(geometry: Any, area: bool) -> Iterator[_Ring]:
    geometry = _plain(geometry)
    if geometry is None:
        return
    if not _is_mapping(geometry):
        vertices = _vertices(geometry)
        yield area, vertices[:-1] if area and len(vertices) > 1 and vertices[0][:2] == vertices[-1][:2] else vertices
        return
    kind, at = geometry.get("type"), geometry.get("coordinates") or ()
    if kind == "GeometryCollection":
        for one in geometry.get("geometries") or ():
            yield from _parts(one, area)
    elif kind in ("LineString", "MultiLineString"):
        for line in [at] if kind == "LineString" else at:
            vertices = _vertices(line)
            if area and (len(vertices) < 2 or vertices[0][:2] != vertices[-1][:2]):
                raise UsageError("it is a line that does not end where it begins", hint="lakes, boundaries and holes are rings")
            yield area, vertices[:-1] if area else vertices
    elif kind in ("Polygon", "MultiPolygon"):
        for ring in at if kind == "Polygon" else (ring for polygon in at for ring in polygon):
            yield True, _vertices(ring)[:-1]  # the last vertex repeats the first one
    elif kind == "LinearRing":  # shapely's
        yield True, _vertices(at)[:-1]
    else:
        raise UsageError("a %s is no line" % kind)


def _vertices(rows: Any) -> List[Tuple[str, str, str]]:
    found = []
    for row in rows.tolist() if hasattr(rows, "tolist") else rows:
        row = tuple(row) if isinstance(row, Iterable) else ()
        if len(row) < 3:
            raise UsageError("vertex %d has no z" % (len(found) + 1), hint="lines have a height at each vertex: nothing is draped onto the points")
        found.append((_number(row[0]), _number(row[1]), _number(row[2])))
    return found


def _number(value: Any) -> str:
    """All of its digits."""
    try:
        if not math.isfinite(value):
            raise UsageError("%r is no coordinate" % (value,))
    except TypeError:
        raise UsageError("%r is no coordinate" % (value,)) from None
    if isinstance(value, (decimal.Decimal, int)) and not isinstance(value, bool):
        return str(value)
    return repr(float(value))


def _kind(word: Any, what: str) -> str:
    kind = str(word).lower()
    if kind not in KINDS + ("soft",):
        raise UsageError("%s is %r, and no kind of lines" % (what, word), hint="kinds are hard, soft, lake, boundary and hole")
    return "hard" if kind == "soft" else kind


def _unit(name: str) -> str:
    unit = {"metre": "m", "foot": "ft", "us-survey-foot": "ftUS"}.get(name, name)
    if unit not in ("m", "ft", "ftUS"):
        raise UsageError("units are m, ft and ftUS: %r" % (name,))
    return unit


def _head(crs: Any, units: Optional[str], densify: Union[float, str, None], lake_level: Optional[str]) -> Iterator[str]:
    yield "acut-lines 1"
    text = " ".join(str(crs.to_wkt() if hasattr(crs, "to_wkt") else crs or "").split())
    if text:
        yield "crs " + text
    if units:
        xy, _, z = units.partition(",")
        if not text:
            yield "unit " + _unit(xy)
        yield "unit-z " + _unit(z or xy)
    if densify is not None:
        length = re.fullmatch(r"([0-9.]+(?:e[+-]?[0-9]+)?) ?(m|ft|ftUS|)", str(densify))
        if not length:
            raise UsageError("densify is a length, as 5 or \"5m\": %r" % (densify,))
        yield ("densify %s %s" % length.groups()).rstrip()
    if lake_level is not None:
        if lake_level not in ("min", "max", "mean"):
            raise UsageError("lake_level is min, max or mean: %r" % (lake_level,))
        yield "lake-level " + lake_level
