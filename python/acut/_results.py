"""Results of calls: plain, frozen objects with their own memory. Names are those of acut.h; times are datetimes in UTC."""
import ctypes
import dataclasses
import datetime
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Tuple, Type, TypeVar

from ._errors import Error, from_failure
from ._library import decoded

T = TypeVar("T")
Three = Tuple[float, float, float]


def take(cls: Type[T], struct: Any, **more: Any) -> T:
    """The fields of a dataclass from those of a struct of the same names; "submitted" also from "submitted_us"."""
    given: Dict[str, Any] = dict(more)
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        name = field.name
        if name in given:
            continue
        if hasattr(struct, name):
            given[name] = plain(getattr(struct, name))
        elif hasattr(struct, name + "_us"):
            given[name] = _time(getattr(struct, name + "_us"))
    return cls(**given)


def plain(value: Any) -> Any:
    if value is None:
        return ""
    if isinstance(value, bytes):
        return decoded(value)
    if isinstance(value, ctypes.Array):
        return tuple(plain(v) for v in value)
    return value


def rows(cls: Type[T], pointer: Any, count: int) -> List[T]:
    return [take(cls, pointer[i]) for i in range(count)]


def _time(us: int) -> Optional[datetime.datetime]:
    epoch = datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
    return epoch + datetime.timedelta(microseconds=us) if us else None


# ---- the daemon ----

@dataclass(frozen=True)
class LedgerEntry:
    name: str
    bytes: int  # held now
    peak: int   # the most since the start; 0 in a holder's list


@dataclass(frozen=True)
class Holder:
    kind: str  # "job", "fetch", "plan", "push", "info" or "connection"
    what: str  # the dataset, or ""
    id: int
    uid: int
    pid: int
    held: List[LedgerEntry]


@dataclass(frozen=True)
class Side:
    """The file system of one of the daemon's folders, and the use of it."""
    known: bool
    has_quota: bool
    used: int
    quota: int
    total: int
    free: int
    keep_free: int


@dataclass(frozen=True)
class Status:
    version: str
    state_dir: str
    cache_dir: str
    pid: int
    memory: int
    peak_rss_bytes: int
    rss_bytes: int
    threads: int
    jobs_running: int
    jobs_waiting: int
    connections: int
    uptime_seconds: float
    pipe_capacity: int
    ledger_peak: int
    disk_limit: str
    keep_free_limit: str
    one_file_system: bool
    holders_more: int
    ledger: List[LedgerEntry]
    holders: List[Holder]
    state_side: Side
    cache_side: Side


def status(s: Any) -> Status:
    holders = [take(Holder, h, held=rows(LedgerEntry, h.held, h.nheld)) for h in s.holders[:s.nholders]]
    return take(Status, s, ledger=rows(LedgerEntry, s.ledger, s.nledger), holders=holders,
                state_side=take(Side, s.state_side), cache_side=take(Side, s.cache_side))


@dataclass(frozen=True)
class Setting:
    """A setting of the daemon, as acutd.conf would say it."""
    name: str
    value: str   # "": unset
    preset: str  # what it is where nobody sets it; "": preset_told says
    preset_told: str
    unit: str
    help: str
    origin: str  # "default", "environment", "control_group", "file", "command_line"
    file: str
    line: int
    reload: bool


@dataclass(frozen=True)
class Metric:
    """One sample, see acut-metrics(7)."""
    name: str
    type: str  # "counter", "gauge"
    help: str
    labels: Dict[str, str]
    value: float


def metric(s: Any) -> Metric:
    words = [decoded(s.label[i]) for i in range(2 * s.nlabel)]
    return take(Metric, s, labels=dict(zip(words[::2], words[1::2])))


@dataclass(frozen=True)
class Check:
    """The result of one check of the doctor."""
    name: str
    state: str    # "ok", "warning", "wrong", "unknown"
    message: str
    hint: str     # what to do; "": nothing


@dataclass(frozen=True)
class Progress:
    phase: str  # "stage", "seal", "select", "simplify", "check", "mesh"
    points: int
    points_total: int
    domains: int
    domains_total: int
    seconds_left: float  # 0: not known
    waiting: str         # what a job waits for, in words; "": nothing


# ---- datasets ----

@dataclass(frozen=True)
class Dataset:
    name: str
    generation: int
    points: int
    bytes: int
    files: int
    uid: int
    gid: int   # 4294967295: no group
    mode: int  # as of a file: 0o640
    lattice: str
    crs: str
    unit_xy: str
    unit_z: str
    min: Three  # NaN where the daemon does not say
    max: Three
    created: Optional[datetime.datetime]
    pushed: Optional[datetime.datetime]
    removed: Optional[datetime.datetime]  # None: it is there
    until: Optional[datetime.datetime]    # else until when it can be restored
    pending: str     # an interrupted push, in words
    pinned: bool
    merging: bool
    id: int
    oldest: int      # generation that can be read
    segments: int
    epsg: int        # EPSG number of the system of x and y; 0: not known
    epsg_z: int      # that of the system of heights
    vertical: str    # the system of heights, "EPSG:5720" or a name; ""
    wkt: str         # the system as the first file had it; "": none had one, and of a list
    geoid: str       # "WAY HASH NAME" of the grid that converted the heights; "": none did, and of a list
    line_files: int  # of `files`; 0 of a list, as the next three
    features: Tuple[int, int, int, int]  # of files of lines: hard, lake, boundary, hole
    lines: int
    vertices: int


@dataclass(frozen=True)
class LogFile:
    name: str
    path: str   # as the client saw it; "": a pipe, or not for this user
    hash: str   # XXH3-128 of its bytes; "": not known
    points: int
    size: int
    source: int
    removed: bool  # by the generation, not added
    overridden: str  # what its records said of its coordinates, where the push overrode that; else ""
    of_lines: bool   # a file of lines, which has no points, but the next three
    features: Tuple[int, int, int, int]  # hard, lake, boundary, hole
    lines: int
    vertices: int


@dataclass(frozen=True)
class Generation:
    number: int
    kind: str    # "push", "revert", "replace", "prune", "import"
    undoes: int  # the generation that it undoes, or up to which was pruned; 0: none
    time: Optional[datetime.datetime]
    user: str
    uid: int
    content: str
    points_added: int
    points_removed: int
    files: int
    files_removed: int
    readable: bool
    changes: List[LogFile] = dataclasses.field(default_factory=list)  # the files themselves, where they were asked for


@dataclass(frozen=True)
class Reverted:
    generation: int
    undone: int
    points: int
    files: int
    files_removed: int
    points_added: int
    points_removed: int


@dataclass(frozen=True)
class Pruned:
    oldest: int
    generations: int
    files: int
    points: int
    bytes: int
    segments: int


@dataclass(frozen=True)
class Discarded:
    pushes: int
    files: int
    bytes: int
    open: List[int]  # the numbers of pushes that are open and keep what they have


@dataclass(frozen=True)
class Imported:
    dataset: str
    generation: int
    points: int


# ---- push ----

@dataclass(frozen=True)
class PushedFile:
    """The result for one input."""
    name: str
    state: str  # "staged", "known" (there already), "adopted" (from an interrupted push), "refused"
    points: int = 0
    moved: int = 0  # points that were rounded to the lattice, by at most max_shift
    max_shift: Three = (0.0, 0.0, 0.0)
    replaced: int = 0  # files of the dataset, in the place of which it came
    warning: str = ""
    projected_from: str = ""
    overridden: str = ""  # what its records say of its coordinates, in place of which something else was taken
    geoid: str = ""
    left_out: int = 0  # lines of a text without a value for a coordinate, the first being left_out_line
    left_out_line: int = 0
    bytes_read: int = 0
    bytes: int = 0
    partial: bool = False
    error: Optional[Error] = None


@dataclass(frozen=True)
class LineSet:
    """All lines of a dataset together, and what became of them."""
    features: Tuple[int, int, int, int]  # hard, lake, boundary, hole
    lines: int
    vertices: int
    positions: int
    pieces: int     # edges of the mesh
    crossings: int  # where lines cross between their vertices
    uneven: int     # positions with vertices of different heights
    widest: float   # the largest difference of heights at these, and where it is
    widest_at: Tuple[float, float]
    left_out: int   # pieces outside of the boundary, or in a hole
    doubled: int    # segments that lie on others
    points: int     # segments without length


@dataclass(frozen=True)
class LinePlace:
    """Where lines cross, or where vertices of lines have different heights."""
    kind: str  # "crossing", "uneven"
    x: float
    y: float
    lower: float  # the two heights
    upper: float


@dataclass(frozen=True)
class Pushed:
    """A committed push. If files were refused (see `refused`), the others are committed."""
    dataset: str
    generation: int  # of the dataset, now: no new one where no point came and none went; 0: it has none
    points: int  # of the dataset, now
    unchanged: bool  # it made no generation
    files: List[PushedFile]
    note: str    # what was there of interrupted pushes, and what was dropped; "": nothing
    line_set: Optional[LineSet] = None  # where the push changed the lines, and some are left

    @property
    def refused(self) -> List[PushedFile]:
        return [f for f in self.files if f.error is not None]

    @property
    def exit_status(self) -> int:
        """The exit status of acutctl push: 0, or 3 if files were refused."""
        return 3 if self.refused else 0


@dataclass(frozen=True)
class Info:
    """The header of a file."""
    name: str
    format: str
    variant: str
    crs: str
    datum: str
    crs_name: str  # names that EPSG has for the numbers, "A", "A + B"; "": none
    epsg: int
    epsg_z: int
    wkt: str       # of its system, in one line; "": none
    unit_xy: str
    unit_z: str
    plane: str
    warning: str
    left_out: int  # lines of a text without a value for a coordinate, the first being left_out_line
    left_out_line: int
    points: int
    min: Three
    max: Three
    scale: Tuple[str, str, str]
    offset: Tuple[str, str, str]


@dataclass(frozen=True)
class Inspected:
    """Statistics of the records of a file."""
    header: Info
    points: int
    distinct: int
    min: Three
    max: Three
    classes: Dict[int, int]
    returns: Dict[int, int]
    return_counts: Dict[int, int]
    flags: Dict[str, int]
    hull_corners: int
    hull_thinned: bool
    hull_area: float
    lattice: str
    has_place: bool
    no_place: str
    area: float
    perimeter: float
    south: float
    west: float
    north: float
    east: float
    mgrs: str
    differences: List[str]
    inner_min: Three  # of 99.9 % of the records at least
    inner_max: Three
    most_points: int  # at the position that most records share; 0: each has one, or it is not known
    most_at: Tuple[float, ...]


def inspected(s: Any) -> Inspected:
    def counts(array: Any) -> Dict[int, int]:
        return {i: n for i, n in enumerate(array) if n}

    return take(Inspected, s, header=take(Info, s.header), classes=counts(s.classes), returns=counts(s.returns),
                return_counts=counts(s.return_counts),
                flags=dict(zip(("withheld", "synthetic", "key-point", "overlap"), s.flags)),
                differences=[decoded(s.difference[i]) for i in range(s.ndifference)])


@dataclass(frozen=True)
class Geoid:
    name: str
    hash: str
    description: str
    date: str
    width: int
    height: int
    uid: int
    bytes: int
    min: float
    max: float
    rms_error: float
    max_error: float


# ---- the disk ----

@dataclass(frozen=True)
class CacheKind:
    name: str
    bytes: int
    entries: int
    state: bool


@dataclass(frozen=True)
class CacheStat:
    kinds: List[CacheKind]
    state: Side
    cache: Side
    one_file_system: bool
    measured: bool
    disk_limit: str
    keep_free_limit: str
    evicted_bytes: int
    evicted_entries: int


def cache_stat(s: Any) -> CacheStat:
    return take(CacheStat, s, kinds=rows(CacheKind, s.kinds, s.nkinds), state=take(Side, s.state), cache=take(Side, s.cache))


@dataclass(frozen=True)
class Damage:
    what: str
    dataset: str
    derived: bool
    removed: bool
    error: Error


@dataclass(frozen=True)
class Adopted:
    packs: int
    domains: int
    bytes: int
    there: int
    flat: int


@dataclass(frozen=True)
class Verified:
    files: int
    bytes: int
    damaged: int
    derived: int
    newer: int
    derived_newer: int
    damages: List[Damage]


# ---- jobs ----

@dataclass(frozen=True)
class Report:
    points: int
    used: int
    vertices: int
    triangles: int
    hull: int
    domains: int
    domains_reused: int
    halo: int
    points_read: int
    cells_read: int
    peak_rss_bytes: int
    digest: str
    vertex_digest: str
    seconds: float
    stage_seconds: float
    seal_seconds: float
    plan_seconds: float
    domains_seconds: float
    first_triangle_seconds: float
    window: bool
    note: str
    removed: Dict[str, int]  # points, by the rule that left them out
    most_points: int         # of the view, at the position that most of them share; 0: each has one, or it is not known
    most_at: Tuple[float, ...]
    max_error: str           # of a view with max_error or max_points: the bound that holds, in units of the heights; "": of another view
    positions: int           # then: positions of all points of the view
    kept: int                # those kept
    rounds: int              # rounds that added some after the first choice
    attempts: int            # bounds that were tried
    largest_error: str       # the greatest distance of a point, rounded up to a thousandth of the lattice; "": unknown, of an earlier version


@dataclass(frozen=True)
class Job:
    id: int
    dataset: str
    generation: int
    view: str
    state: str
    lattice: str
    crs: str
    unit_xy: str
    unit_z: str
    uid: int
    pid: int
    submitted: Optional[datetime.datetime]
    finished: Optional[datetime.datetime]
    progress: Progress
    priority: str
    waiting: str
    lacks_space: int
    position: int
    final: bool
    report: Optional[Report]
    error: Optional[Error]  # why it failed; not raised here
    notes: List[str] = dataclasses.field(default_factory=list)  # of submit: what whoever asked should know

    def __index__(self) -> int:
        return self.id


def job(s: Any) -> Job:
    report = None
    if s.has_report:
        r = s.report
        report = take(Report, r, removed={decoded(r.removed[i].rule): r.removed[i].count for i in range(r.nremoved)})
    return take(Job, s, progress=take(Progress, s.progress), report=report,
                error=from_failure(s.error) if s.has_error else None)


@dataclass(frozen=True)
class Plan:
    points: int
    domains: int
    domains_reused: int
    memory_bytes: int
    disk_bytes: int
    exact: bool
    seconds: float
    load: int
    threads: int
    notes: List[str] = dataclasses.field(default_factory=list)  # what whoever asks should know
