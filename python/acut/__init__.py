"""acut: terrain meshes from LiDAR, made by acutd.

    import acut

    with acut.connect() as server:
        pushed = server.push("valley", ["a.laz", "b.laz"])
        job = server.submit("valley", ground=True)
        mesh = server.mesh(job)             # waits until it is made
        print(len(mesh.triangles), mesh.digest)

connect() returns a Connection, whose methods correspond to the commands of acutctl(1). All failures are subclasses of Error,
one for each error code; `exit_status` is the exit status of acutctl for that error. Results are plain objects; times are in UTC.

Arrays are memoryviews, most of shape (n, 3). numpy is not needed, but can use them without copying:

    vertices = numpy.asarray(mesh.vertices)        # float64
    triangles = numpy.asarray(mesh.triangles)      # uint64

Without numpy, `.tolist()` gives lists of three numbers. A mesh that does not fit into memory can be read in blocks:

    with server.fetch(job) as blocks:
        for block in blocks:
            use(block.coordinates, block.triangles)
        digest = blocks.tail.digest

Breaklines, lakes, boundaries and holes are pushed as other inputs are:

    server.push("valley", [acut.Lines(roads, name="roads"), acut.Lines(lakes, kind="lake", name="lakes")])

Both digests of a mesh are computed here and compared (DigestError). A mesh is complete only after its last block was read.

Threads: only one thread at a time may use a connection; open one in each. Ctrl-C ends a call. So does an exception in a progress
function: the call then raises it. A connection is closed by close(), by `with`, and when it is dropped.

The module needs libacut.so.0 (or the file that the environment variable ACUT_LIBRARY names) and nothing else; Connection.volume
also runs the program acutctl.
"""
from ._abi import VERSION as __version__
from ._backup import BackupFile
from ._connection import SYSTEM_SOCKET, Connection, connect
from ._errors import (BusyError, CancelledError, ChangedError, CorruptError, DigestError, Error, GoneError, InputError,
                      InternalError, LimitError, NoDaemonError, NoMemoryError, NoSpaceError, NotFoundError,
                      NotPermittedError, ProtocolError, ReadWriteError, TimedOutError, ConflictError, TruncatedError, UnsupportedError,
                      UsageError, VersionError)
from ._lines import Lines
from ._mesh import Base, Block, Fetch, Head, Mesh, Region, Tail
from ._results import (Adopted, CacheKind, CacheStat, Check, Damage, Dataset, Discarded, Generation, Geoid, Holder, Imported, Info, Inspected, Job,
                       LedgerEntry, LinePlace, LineSet, LogFile, Metric, Plan, Progress, Pruned, Pushed, PushedFile, Report, Reverted, Setting,
                       Side, Status, Verified)
from ._view import view_text
from ._volume import ComparedMesh, Volume, Volumes

__all__ = [
    "connect", "Connection", "Lines", "view_text", "SYSTEM_SOCKET",
    "Fetch", "Block", "Mesh", "Head", "Tail", "Base", "Region",
    "Pushed", "PushedFile", "LineSet", "LinePlace", "Job", "Report", "Progress", "Plan", "Dataset", "Generation", "LogFile", "Reverted", "Pruned", "Discarded",
    "Imported", "Info", "Inspected", "Geoid", "Status", "Setting", "Side", "Holder", "LedgerEntry", "CacheStat", "CacheKind",
    "Adopted", "Verified", "Damage", "Metric", "Check", "BackupFile", "Volumes", "Volume", "ComparedMesh",
    "Error", "InputError", "TruncatedError", "ChangedError", "LimitError", "CancelledError", "GoneError", "DigestError",
    "InternalError", "UsageError", "UnsupportedError", "NotFoundError", "NoDaemonError", "ReadWriteError", "NoSpaceError",
    "CorruptError", "BusyError", "NoMemoryError", "ProtocolError", "VersionError", "NotPermittedError", "TimedOutError", "ConflictError",
]
for _name in __all__:
    if isinstance(globals()[_name], type):
        globals()[_name].__module__ = "acut"
del _name
