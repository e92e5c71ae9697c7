#!/usr/bin/python3
"""nightly-ingest.py FOLDER DATASET OUT: what has arrived in FOLDER goes into DATASET, and OUT/ground-DATE.ply is its ground.

The same as nightly-ingest.sh, by the module acut. Run it every night as a user who may push (group acut). Everything may go
wrong: it can be killed at any moment, run twice at once, and run again; no file is lost, none is taken twice.

  FOLDER/*.las ...      what arrived; names that begin with a dot or end in .part, .tmp or ~ are left alone
  FOLDER/done/          files whose points are in the dataset
  FOLDER/failed/        broken ones, each with NAME.error beside it that says what is wrong
  OUT/ground-DATE.ply   whole, or not there; OUT/ground.ply is a link to the newest
  FOLDER/ingest.log     a line a night

Exit status: 0 all that has arrived is in, or still arrives (a half-copied file waits, for two days at most); 3 the same, but
a broken file was set aside; 75 another run is at work, or the daemon was busy for too long; else as acutctl (69 no daemon,
74 no space or a bad disk, 77 not permitted): all is where it was, the next night goes on.
"""
import datetime
import fcntl
import os
import shutil
import stat
import struct
import sys
import time

import acut

PAUSES = [float(p) for p in os.environ.get("PAUSES", "10 30 60 300 900").split()]  # seconds between tries
PATIENCE = float(os.environ.get("PATIENCE", 2 * 86400))  # a file that is half there for so long is broken
NIGHT = os.environ.get("NIGHT") or datetime.date.today().isoformat()
ENDINGS = (".las", ".laz", ".xyz", ".txt", ".csv")


def say(text):
    print("nightly-ingest:", text, file=sys.stderr)


def patient(work):
    """work(connection), on a new connection. What time may mend is tried again: no daemon (69), a disk that is full or
    fails (74), busy (75), no answer (124)."""
    for pause in PAUSES + [None]:
        try:
            with acut.connect(program="nightly-ingest") as server:
                return work(server)
        except acut.Error as e:
            if e.exit_status not in (69, 74, 75, 124) or pause is None:
                raise
        time.sleep(pause)


def identity(path):
    """Who a file is: another one under its name, or a change to it, is seen by it."""
    try:
        s = os.lstat(path)
    except FileNotFoundError:
        return None
    return (s.st_dev, s.st_ino, s.st_size, s.st_mtime_ns) if stat.S_ISREG(s.st_mode) else None


def move(path, was, folder):
    """A file that was dealt with; but if it is not the one that was read, it goes back, for the next run."""
    name = os.path.basename(path)
    to, n = os.path.join(folder, name), 0
    while os.path.lexists(to):
        n += 1
        to = os.path.join(folder, "%s.~%d~" % (name, n))
    os.rename(path, to)
    if identity(to) != was:
        say("%s was delivered again meanwhile; the next run takes it" % name)
        try:
            os.link(to, path)  # not over a third one
            os.unlink(to)
        except FileExistsError:
            pass


def ingest(folder, dataset, count):
    """All that has arrived, in one push: one generation of the dataset. True: something was set aside."""
    files = {}
    for name in sorted(os.listdir(folder)):
        path = os.path.join(folder, name)
        if name.lower().endswith(ENDINGS) and not name.startswith(".") and identity(path):
            files[path] = identity(path)
    if not files:
        return
    try:
        results = patient(lambda server: server.push(dataset, list(files), checksum=True, replace=True)).files
    except (acut.InputError, acut.LimitError, acut.UnsupportedError):
        # There was not one good file: each alone, to hear what is wrong with it.
        results = []
        for path in files:
            try:
                results += patient(lambda server, path=path: server.push(dataset, path, checksum=True, replace=True)).files
            except (acut.InputError, acut.LimitError, acut.UnsupportedError) as e:
                results.append(acut.PushedFile(path, "refused", error=e))
    for result in results:
        path, e = result.name, result.error
        if e is None:
            count["known" if result.state == "known" else "added"] += 1
            move(path, files[path], os.path.join(folder, "done"))
        elif isinstance(e, (acut.TruncatedError, acut.ChangedError)) and time.time() - files[path][3] / 1e9 < PATIENCE:
            count["waiting"] += 1  # half of a file, or one that grew while it was read, may still be on its way
        elif isinstance(e, acut.NotPermittedError):
            raise e
        else:
            count["broken"] += 1
            say("%s is set aside: %s" % (os.path.basename(path), e))
            with open(os.path.join(folder, "failed", os.path.basename(path) + ".error"), "w") as f:
                f.write("%s: %s\n" % (e.code, e))
            move(path, files[path], os.path.join(folder, "failed"))


def write_ply(server, job, path):
    """The mesh as binary PLY, block by block: faces go to a second file, since all vertices come before them."""
    face, report = struct.Struct("<B3I"), job.report
    with open(path + ".part", "wb") as out, open(path + ".faces", "wb+") as faces, server.fetch(job) as blocks:
        out.write(("ply\nformat binary_little_endian 1.0\ncomment acut-lattice %s\ncomment acut-digest %s %s\n"
                   "element vertex %d\nproperty double x\nproperty double y\nproperty double z\n"
                   "element face %d\nproperty list uchar uint vertex_indices\nend_header\n"
                   % (blocks.head.lattice, report.digest, report.vertex_digest, report.vertices, report.triangles)).encode())
        for block in blocks:
            out.write(block.coordinates)
            faces.write(b"".join(face.pack(3, *t) for t in block.triangles.tolist()))
        faces.seek(0)
        shutil.copyfileobj(faces, out, 1 << 20)
        out.flush()
        os.fsync(out.fileno())
    os.unlink(path + ".faces")
    os.rename(path + ".part", path)


def mesh(dataset, out):
    """The ground as of now, under its name when it is whole. The same mesh as before is not made again. What to log."""
    path = os.path.join(out, "ground-%s.ply" % NIGHT)

    def make(server):
        job = server.wait(server.submit(dataset, ground=True))
        write_ply(server, job, path)
        return job

    try:
        job = patient(make)
    except acut.NotFoundError:
        return "mesh=none"  # nothing good has ever arrived
    link = os.path.join(out, "ground.ply")
    if os.path.lexists(link + ".new"):
        os.unlink(link + ".new")
    os.symlink(os.path.basename(path), link + ".new")
    os.rename(link + ".new", link)
    return "job=%d digest=%s mesh=%s" % (job.id, job.report.digest, os.path.basename(path))


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__.splitlines()[0])
    folder, dataset, out = sys.argv[1:]
    for path in (os.path.join(folder, "done"), os.path.join(folder, "failed"), out):
        os.makedirs(path, exist_ok=True)
    lock = open(os.path.join(folder, ".lock"), "a")  # held until this process ends
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        say("another run is at work in %s" % folder)
        return 75
    count, more, status = {"added": 0, "known": 0, "broken": 0, "waiting": 0}, "", 1
    try:
        ingest(folder, dataset, count)
        more = mesh(dataset, out)
        status = 3 if count["broken"] else 0
    except acut.Error as e:
        say("%s; the next run goes on" % e)
        status = e.exit_status
    except OSError as e:
        say("%s; the next run goes on" % e)
        status = 74
    counts = " ".join("%s=%d" % c for c in count.items())
    with open(os.path.join(folder, "ingest.log"), "a") as log:
        log.write("%s night=%s dataset=%s status=%d %s %s\n"
                  % (datetime.datetime.now().isoformat(timespec="seconds"), NIGHT, dataset, status, counts, more))
    lock.close()
    return status


if __name__ == "__main__":
    sys.exit(main())
