"""acut: terrain meshes from LiDAR, asked from acutd.

    import acut

    with acut.connect() as server:
        pushed = server.push("valley", ["a.laz", "b.laz"])
        job = server.submit("valley", ground=True)
        mesh = server.mesh(job)             # waits until it is made
        print(len(mesh.triangles), mesh.digest)

connect() gives a Connection, whose methods are what acutctl(1) can be asked for. All failures are exceptions below Error,
one class a code; `exit_status` is what acutctl ends with for it. Results are plain objects; times are in UTC.

Arrays are memoryviews with a shape, (n, 3) as a rule. numpy is not needed, and takes them without copying:

    vertices = numpy.asarray(mesh.vertices)        # float64
    triangles = numpy.asarray(mesh.triangles)      # uint64

Without it, `.tolist()` gives lists of three. A mesh that does not fit into memory comes in blocks:

    with server.fetch(job) as blocks:
        for block in blocks:
            use(block.coordinates, block.triangles)
        digest = blocks.tail.digest

Both digests of a mesh are computed on this side and compared (DigestError); until the last block was taken, it is not
known to be whole.

Threads: a connection is for one thread at a time; open one in each. Ctrl-C ends a call; so does an exception in a progress
function, which is raised by the call. A connection is closed by close(), by `with`, and when it is dropped.

It needs libacut.so.0 (the environment's ACUT_LIBRARY names another file) and nothing else.
"""
from ._abi import VERSION as __version__
from ._backup import BackupFile
from ._connection import SYSTEM_SOCKET, Connection, connect
from ._errors import (BusyError, CancelledError, ChangedError, CorruptError, DigestError, Error, GoneError, InputError,
                      InternalError, LimitError, NoDaemonError, NoMemoryError, NoSpaceError, NotFoundError,
                      NotPermittedError, ProtocolError, ReadWriteError, TimedOutError, ConflictError, TruncatedError, UnsupportedError,
                      UsageError, VersionError)
from ._mesh import Base, Block, Fetch, Head, Mesh, Region, Tail
from ._results import (CacheKind, CacheStat, Check, Damage, Dataset, Generation, Geoid, Holder, Imported, Info, Inspected, Job,
                       LedgerEntry, LogFile, Metric, Plan, Progress, Pruned, Pushed, PushedFile, Report, Reverted, Setting,
                       Side, Status, Verified)
from ._view import view_text

__all__ = [
    "connect", "Connection", "view_text", "SYSTEM_SOCKET",
    "Fetch", "Block", "Mesh", "Head", "Tail", "Base", "Region",
    "Pushed", "PushedFile", "Job", "Report", "Progress", "Plan", "Dataset", "Generation", "LogFile", "Reverted", "Pruned",
    "Imported", "Info", "Inspected", "Geoid", "Status", "Setting", "Side", "Holder", "LedgerEntry", "CacheStat", "CacheKind",
    "Verified", "Damage", "Metric", "Check", "BackupFile",
    "Error", "InputError", "TruncatedError", "ChangedError", "LimitError", "CancelledError", "GoneError", "DigestError",
    "InternalError", "UsageError", "UnsupportedError", "NotFoundError", "NoDaemonError", "ReadWriteError", "NoSpaceError",
    "CorruptError", "BusyError", "NoMemoryError", "ProtocolError", "VersionError", "NotPermittedError", "TimedOutError", "ConflictError",
]
for _name in __all__:
    if isinstance(globals()[_name], type):
        globals()[_name].__module__ = "acut"
del _name
