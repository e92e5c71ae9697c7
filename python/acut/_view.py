"""Views from keyword arguments with the names of the options of acutctl (acutctl(1), "Views"; protocol.md, "Views").

Numbers are sent as exact decimals, as they were given: the daemon knows the lattice and the unit. As in acutctl, only
contradictions are refused here, and areas become text.
"""
import json
import os
import re
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from typing import Any, Iterable, List, Mapping, Optional, Tuple, Union

from ._errors import InputError, LimitError, UsageError

Number = Union[int, float, str, Decimal]
Box = Tuple[Number, Number, Number, Number]
Area = Union[str, "os.PathLike[str]", Mapping[str, Any], Box]

_TEXT_MOST = 49152
_CODE = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_."


def view_text(*, class_: Any = None, not_class: Any = None, ground: bool = False, surface: bool = False,
              returns: Optional[str] = None, keep_withheld: bool = False, keep_noise: bool = False,
              drop_overlap: bool = False, duplicates: Optional[str] = None, zmin: Optional[Number] = None,
              zmax: Optional[Number] = None, crop: Optional[Area] = None, bbox: Optional[Any] = None,
              polygon: Optional[Area] = None, every: Optional[int] = None, thin: Optional[Number] = None,
              thin_pick: Optional[str] = None, no_breaklines: bool = False,
              breakline_clear: Optional[Number] = None, max_error: Optional[Number] = None,
              max_points: Optional[int] = None, metric: Any = None,
              weight: Any = None, hidden: bool = False) -> str:
    """The text of the view that these words ask for: view_text(ground=True, crop=(0, 0, 500, 500)).

    class_, not_class  classes: 2, [2, 8] or "2-5,9"; class_ has its underscore because `class` is Python's
    ground             classes 2 and 8 and key-points, the lowest of a position
    surface            first returns, the highest of a position
    returns            "all", "first" or "last"
    duplicates         "lowest" or "highest" point of a position
    keep_withheld, keep_noise, drop_overlap   as the options of acutctl
    zmin, zmax         heights in the units of the files
    crop               only points inside: (x1, y1, x2, y2) or the same as a text, GeoJSON as a mapping, or the path of a
                       file of GeoJSON or WKT
    bbox, polygon      only those triangles of the whole mesh that meet this area; bbox is a box, polygon anything of crop
    every              about one position of so many
    thin               one point a square cell of this side: 10 in file units, or "10m", "30ft", "30ftUS"
    thin_pick          "lowest", "highest" or "median" point of a cell
    no_breaklines      without the lines of the dataset
    breakline_clear    no points nearer than this to a line, a length like that of thin, or 0
    max_error          the fewest points such that none is further than this above or below the mesh, likewise
    max_points         at most so many vertices, with about the least error of all points that this allows
    metric             (P, Q, K) or "P,Q,K", whole numbers: distances across the direction P, Q count K times
    weight             points of a class, or of a file, hide points of less weight within about its radius:
                       {2: 1.5, "survey-2024/*.laz": "0.5m"} or a text, "2=1.5,9=30ft"; radii are lengths like that of thin
    hidden             the mesh is the positions that these hide: vertices without triangles (Block.origins)
    """
    _check_words("returns", returns, ("all", "first", "last"))
    _check_words("duplicates", duplicates, ("lowest", "highest"))
    _check_words("thin_pick", thin_pick, ("lowest", "highest", "median"))
    highest = duplicates == "highest"
    if thin_pick and thin is None:
        raise UsageError("thin_pick says which point of a cell is taken, and there are no cells", hint="give thin too")
    if ground and surface:
        raise UsageError("a mesh cannot be of the ground and of the surface at once",
                         hint="submit two jobs on one dataset: they share its points")
    if surface and returns == "last":
        raise UsageError("the surface is made of first returns, not of last ones")
    if surface and duplicates and not highest:
        raise UsageError("the surface is the highest of several points of one position",
                         hint='use returns="first", duplicates="lowest"')
    if ground and highest:
        raise UsageError("the ground is the lowest of several points of one position",
                         hint='use class_="2,8", duplicates="highest"')
    if zmin is not None and zmax is not None and _decimal(zmin, "zmin") > _decimal(zmax, "zmax"):
        raise UsageError("zmin %s is above zmax %s: no height is left" % (zmin, zmax), hint="swap them")
    clear = _length(breakline_clear, "breakline_clear") if breakline_clear is not None else ""
    direction = _metric(metric) if metric is not None else ""
    # Values that change nothing contradict nothing.
    if no_breaklines and re.search("[1-9]", re.split("[eE]", clear)[0]):
        raise UsageError("without lines no point is near one", hint="leave out one of no_breaklines and breakline_clear")
    if max_error is not None and max_points is not None:
        raise UsageError("max_points looks for the bound that max_error gives", hint="leave out one of them")
    if (max_error is not None or max_points is not None) and direction and not direction.endswith(",1"):
        raise UsageError("a metric has no bound of errors", hint="leave out metric, or max_error and max_points")
    words = ["ask 1"]
    words += ["class=%s" % _classes(class_)] if class_ is not None else []
    words += ["not-class=%s" % _classes(not_class)] if not_class is not None else []
    words += ["ground"] if ground else []
    words += ["returns=first"] if surface or returns == "first" else ["returns=last"] if returns == "last" else []
    words += ["keep-withheld"] if keep_withheld else []
    words += ["keep-noise"] if keep_noise else []
    words += ["drop-overlap"] if drop_overlap else []
    words += ["zmin=%s" % _plain(zmin, "zmin")] if zmin is not None else []
    words += ["zmax=%s" % _plain(zmax, "zmax")] if zmax is not None else []
    words += ["every=%d" % _count(every, "every")] if every is not None else []
    if thin is not None:
        words.append("thin=%s:%s" % (_length(thin, "thin"), thin_pick or ("highest" if surface or highest else "lowest")))
    words += ["duplicates=highest"] if surface or highest else []
    words += ["no-breaklines"] if no_breaklines else []
    words += ["breakline-clear=%s" % clear] if clear else []
    words += ["max-error=%s" % _length(max_error, "max_error")] if max_error is not None else []
    words += ["max-points=%d" % _count(max_points, "max_points")] if max_points is not None else []
    words += ["metric=%s" % direction] if direction else []
    words += ["weight=%s" % _weights(weight)] if weight is not None else []
    if hidden and weight is None:
        raise UsageError("without weights nothing is hidden", hint="give weight, too")
    words += ["hidden"] if hidden else []
    words += ["crop=%s" % area_text(crop)] if crop is not None else []
    window = window_text(bbox, polygon)
    words += ["window=%s" % window] if window else []
    text = " ".join(words)
    if len(text) >= _TEXT_MOST:
        raise LimitError("the view takes %d bytes, more than the %d that fit" % (len(text), _TEXT_MOST))
    return text


def window_text(bbox: Any, polygon: Optional[Area]) -> Optional[str]:
    """The area of bbox or polygon alone, as a fetch asks for it; None: there is none."""
    if bbox is not None and polygon is not None:
        raise UsageError("bbox and polygon are two areas, and one can be asked for")
    if bbox is not None:
        box = _box(bbox)
        if box is None:
            raise UsageError("bbox is not x1, y1, x2, y2: %r" % (bbox,), hint="polygon takes GeoJSON or a file")
        return _box_text(box)
    return area_text(polygon) if polygon is not None else None


def area_text(area: Any) -> str:
    """The text of an area in a view: "box:..." or "area@E:RINGS"."""
    if isinstance(area, Mapping):
        return _rings_text(_polygons(area, ""))
    box = _box(area)
    if box is not None:
        return _box_text(box)
    if not isinstance(area, (str, os.PathLike)):
        raise UsageError("an area is x1, y1, x2, y2, GeoJSON as a mapping, or the path of a file, not %r" % (area,))
    with open(area, encoding="utf-8-sig") as f:
        text = f.read()
    try:
        if text.lstrip().startswith("{"):
            document = json.loads(text, parse_float=Decimal)
            return _rings_text(_polygons(document, ""))
        return _rings_text(_wkt(text))
    except json.JSONDecodeError as e:
        raise InputError("it starts as JSON and is not: %s" % e.msg, file=os.fspath(area), offset=e.pos) from None
    except InputError as e:
        e.file = os.fspath(area)
        raise


def _check_words(name: str, word: Optional[str], words: Iterable[str]) -> None:
    if word is not None and word not in words:
        raise UsageError("%s is %s, not %r" % (name, " or ".join('"%s"' % w for w in words), word))


def _classes(value: Any) -> str:
    text = value if isinstance(value, str) else str(value) if isinstance(value, int) else ",".join(str(int(v)) for v in value)
    good = re.fullmatch(r"\d+(-\d+)?(,\d+(-\d+)?)*", text, re.A) is not None
    for part in text.split(",") if good else ():
        first, _, last = part.partition("-")
        good = good and int(first) <= int(last or first) <= 255
    if not good:
        raise UsageError("%r is not a list of classes" % (value,), hint="give numbers from 0 to 255, as in 2,8 or 2-5,9")
    return text


def _count(value: Any, name: str) -> int:
    try:
        number = int(value)
    except (TypeError, ValueError, OverflowError):
        number = 0
    if number != value or number < 1:
        raise UsageError("%s is a whole number from 1, not %r" % (name, value))
    return number


def _metric(value: Any) -> str:
    hint = "give a direction P, Q and how often distances across it count, as in (3, 1, 10)"
    parts = value.split(",") if isinstance(value, str) else value
    try:
        p, q, k = (int(n) for n in parts)
        whole = isinstance(value, str) or [p, q, k] == list(parts)
    except (TypeError, ValueError):
        whole = False
    if not whole:
        raise UsageError("metric is three whole numbers P, Q, K, not %r" % (value,), hint=hint)
    if not p and not q:
        raise UsageError("metric: 0, 0 is no direction", hint=hint)
    if k < 1:
        raise UsageError("metric: K is %d; it must be at least 1" % k, hint=hint)
    return "%d,%d,%d" % (p, q, k)


def _decimal(value: Any, name: str) -> Decimal:
    try:
        number = Decimal(repr(value) if isinstance(value, float) else value)
    except (InvalidOperation, TypeError, ValueError):
        number = Decimal("NaN")
    if not number.is_finite():
        raise UsageError("%s is not a number: %r" % (name, value), hint="give a decimal in the units of the files, as 1250.75")
    return number


def _plain(value: Any, name: str) -> str:
    number = _decimal(value, name)
    return value if isinstance(value, str) and re.fullmatch(r"[-+.\deE]+", value, re.A) else format(number, "f")


def _length(value: Any, name: str) -> str:
    m = re.fullmatch(r"([-+.\deE]+?)(m|ft|ftUS)?", value, re.A) if isinstance(value, str) else None
    number, unit = (m.group(1), m.group(2) or "") if m else (value, "")
    if _decimal(number, name) < 0 or (name == "thin" and _decimal(number, name) == 0):
        raise UsageError("%s is not a length: %r" % (name, value))
    return _plain(number, name) + unit


_METRES = {"metre": Fraction(1), "foot": Fraction(3048, 10000), "us-survey-foot": Fraction(1200, 3937)}
_SUFFIXES = {"m": "metre", "ft": "foot", "ftUS": "us-survey-foot"}


def bound_notes(max_error: Any, lattice: str, unit_z: str) -> List[str]:
    """What is to be said of a bound, which is a multiple of the step of the heights: one that is none is rounded down."""
    asked = _length(max_error, "max_error")
    number = asked.rstrip("mftUS")
    suffix = asked[len(number):]
    words = lattice.split()
    if len(words) < 2 or (suffix and unit_z not in _METRES):
        return []
    step = Fraction(words[1])
    length = Fraction(number) * (_METRES[_SUFFIXES[suffix]] / _METRES[unit_z] if suffix else 1)
    if length % step == 0:
        return []
    holds = Decimal(words[1]) * (length // step)
    return ["max_error %s is rounded down to %s, a multiple of the step of the heights (%s)" %
            (asked, format(holds.normalize(), "f"), words[1])]


def _weights(value: Any) -> str:
    rows: List[Tuple[Any, Any]] = []
    if isinstance(value, str):
        rows = [r.rpartition("=")[::2] for r in value.split(",")]
    elif isinstance(value, Mapping):
        rows = list(value.items())
    if not rows or not all(radius != "" and (_is_file(str(of)) or re.fullmatch(r"\d{1,3}", str(of), re.A) and int(of) <= 255)
                           for of, radius in rows):
        raise UsageError("weight is not a class or a file with a radius: %r" % (value,),
                         hint='give {2: 1.5, "survey-2024/*.laz": "0.5m"} or "2=1.5m,9=30ft"')
    return ",".join("%s:%s" % (_weighted(str(of)), _length(radius, "weight")) for of, radius in rows)


def _is_file(of: str) -> bool:
    return re.search(r"[A-Za-z/*?]|[^\x00-\x7f]", of) is not None


def _weighted(of: str) -> str:
    if not _is_file(of):
        return of
    return "@" + re.sub(rb"[^A-Za-z0-9/*?.\-_\[\]!]", lambda m: b"%%%02X" % m.group()[0], os.fsencode(of)).decode("ascii")


# ---- areas ----

def _box(value: Any) -> Optional[List[Any]]:
    parts = value.split(",") if isinstance(value, str) else value
    if isinstance(parts, (str, bytes, os.PathLike)) or not hasattr(parts, "__len__") or len(parts) != 4:
        return None
    try:
        for p in parts:
            _decimal(p.strip() if isinstance(p, str) else p, "a side")
    except UsageError:
        if isinstance(value, str):
            return None  # a file whose name has three commas
        raise
    return [p.strip() if isinstance(p, str) else p for p in parts]


def _box_text(box: List[Any]) -> str:
    d = [_decimal(p, "a side of the box") for p in box]
    if d[0] > d[2] or d[1] > d[3]:
        raise UsageError("the box is empty: %s" % ",".join(map(str, box)),
                         hint="give the smallest x and y, then the largest")
    return "box:" + ",".join(_plain(p, "a side of the box") for p in box)


Ring = Tuple[bool, List[Tuple[Decimal, Decimal]]]


def _polygons(thing: Any, at: str) -> List[Ring]:
    """All rings of a GeoJSON document (RFC 7946); True: an outer one."""
    def bad(what: str) -> InputError:
        return InputError(what, field=at or None, hint="an area is made of polygons and multipolygons")

    kind = thing.get("type") if isinstance(thing, Mapping) else None
    try:
        if kind == "FeatureCollection":
            return [r for i, f in enumerate(thing["features"]) for r in _polygons(f, "features[%d]" % i)]
        if kind == "Feature":
            return [] if thing["geometry"] is None else _polygons(thing["geometry"], (at + "." if at else "") + "geometry")
        if kind == "GeometryCollection":
            return [r for i, g in enumerate(thing["geometries"]) for r in _polygons(g, "%s.geometries[%d]" % (at, i))]
        if kind not in ("Polygon", "MultiPolygon"):
            raise bad("a %s is no area" % kind if kind else "this is no GeoJSON: it has no type")
        many = [thing["coordinates"]] if kind == "Polygon" else thing["coordinates"]
        return [(i == 0, [(_decimal(c[0], "a coordinate"), _decimal(c[1], "a coordinate")) for c in ring])
                for polygon in many for i, ring in enumerate(polygon)]
    except (KeyError, IndexError, TypeError, UsageError):
        raise bad("what stands here is no %s of RFC 7946" % (kind or "GeoJSON")) from None


def _wkt(text: str) -> List[Ring]:
    """POLYGON and MULTIPOLYGON, with or without Z and M, one or several."""
    token = re.compile(r"\s*([A-Za-z]+|[(),;]|[-+.\deE]+)")
    tokens, at = [], 0
    while text[at:].strip():
        m = token.match(text, at)
        if not m:
            raise InputError("it is neither GeoJSON nor WKT", offset=at)
        tokens.append((m.group(1).upper(), m.start(1)))
        at = m.end()
    tokens.append(("", len(text)))
    tokens.reverse()

    def take(*wanted: str) -> str:
        word, offset = tokens[-1]
        if wanted and word not in wanted:
            raise InputError("%r stands where one of %s should be" % (word, " ".join(wanted)), offset=offset,
                             hint="an area is x1,y1,x2,y2 or polygons as GeoJSON or WKT")
        tokens.pop()
        return word

    def each(read: Any) -> List[Any]:
        if tokens[-1][0] == "EMPTY":
            take()
            return []
        take("(")
        found = [read()]
        while take(",", ")") == ",":
            found.append(read())
        return found

    def corner() -> Tuple[Decimal, Decimal]:
        numbers, offset = [], tokens[-1][1]
        while tokens[-1][0] not in (",", ")", ""):
            numbers.append(take())
        if not 2 <= len(numbers) <= 4:
            raise InputError("a corner has two to four numbers", offset=offset)
        try:
            return _decimal(numbers[0], "a coordinate"), _decimal(numbers[1], "a coordinate")
        except UsageError as e:
            raise InputError(e.message, offset=offset) from None

    rings: List[Ring] = []
    while tokens[-1][0]:
        kind = re.sub("(?<=POLYGON)(Z|M|ZM)$", "", take("POLYGON", "MULTIPOLYGON", "POLYGONZ", "MULTIPOLYGONZ", "POLYGONM",
                                                       "MULTIPOLYGONM", "POLYGONZM", "MULTIPOLYGONZM"))
        if tokens[-1][0] in ("Z", "M", "ZM"):
            take()
        polygons = [each(lambda: each(corner))] if kind == "POLYGON" else each(lambda: each(lambda: each(corner)))
        rings += [(i == 0, r) for p in polygons for i, r in enumerate(p)]
        if tokens[-1][0] == ";":
            take()
    return rings


def _rings_text(rings: List[Ring]) -> str:
    if not rings:
        raise InputError("there is no polygon in it", hint="an area is made of polygons and multipolygons")
    numbers = [v for _, ring in rings for corner in ring for v in corner if v]
    exponent = min((int(v.normalize().as_tuple().exponent) for v in numbers), default=0)
    if exponent < -40:
        raise InputError("a corner has more than 40 digits after the point")
    parts, at = [], [0, 0]
    for outer, ring in rings:
        corners = ring[:-1] if len(ring) > 1 and ring[0] == ring[-1] else ring
        parts.append("+" if outer else "-")
        for corner in corners:
            for axis in (0, 1):
                number = int(corner[axis].scaleb(-exponent))
                parts.append(_code(number - at[axis]))
                at[axis] = number
    text = "area@%d:%s" % (exponent, "".join(parts))
    if len(text) > _TEXT_MOST - 512:
        raise LimitError("the area has %d corners, too many for one view" % (len(numbers) // 2),
                         hint="simplify it (ogr2ogr -simplify), or give fewer digits after the point")
    return text


def _code(step: int) -> str:
    """protocol.md, "RINGS": five bits a character, the lowest first, 32 added to all but the last."""
    n = 2 * step if step >= 0 else -2 * step - 1
    text = ""
    while n >> 5:
        text += _CODE[n & 31 | 32]
        n >>= 5
    return text + _CODE[n]
