"""Backups of a busy daemon, restored on an empty machine; exports and imports of single datasets. All generations keep their
digests, and no incomplete backup is taken for a good one."""
import json
import os
import shutil
import signal
import subprocess
import threading

import e2e
from e2e import expect
from survey import says, tile


def digests(d, name, generation=None):
    args = ["submit", name, "--new", "--wait", "--json"] + (["--generation", str(generation)] if generation else [])
    job = d.ctl(*args).ok().json()
    return job["digest"], job["vertex_digest"], job["points"]


def meshes(d, names):
    out = {}
    for name, newest in names.items():
        for g in range(1, newest + 1):
            out[name, g] = digests(d, name, g)
    return out


def fill(d, base):
    """Three datasets, of one, two and three generations."""
    names = {"a": 1, "b": 2, "c": 3}
    for k, (name, n) in enumerate(names.items()):
        for g in range(n):
            d.ctl("push", name, tile(base, 100 * k + g, n=400)).ok()
    return names


def restored(base, folder, name):
    """A daemon on a copy of the backup, as on an empty machine."""
    d = e2e.Daemon(base, name=name)
    shutil.copytree(folder, d.state)
    return d


def files_of(folder):
    """All files; a daemon that works in the folder may remove some meanwhile."""
    out = {}
    for path, _, names in os.walk(folder):
        for n in names:
            p = os.path.join(path, n)
            try:
                s = os.stat(p)
            except FileNotFoundError:
                continue
            out[os.path.relpath(p, folder)] = (s.st_ino, s.st_mtime_ns)
    return out


def inodes_in(folder):
    """The files in the folder, by name and inode. SQLite's two files and times are left out, since a running daemon may clean up
    and write its catalogue at any time."""
    return {(n, ino) for n, (ino, _) in files_of(folder).items() if not n.endswith(("-wal", "-shm"))}


def no_links(d):
    e2e.until(lambda: not [n for n in os.listdir(d.state) if n.startswith("backup-")], "the links of a backup that is over stay behind")


def whole_state():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        names = fill(d, base)
        want = meshes(d, names)
        to = os.path.join(base, "backup")
        first = d.ctl("backup", to, "--json").ok().json()
        expect(first["new_files"] == first["files"] > 8, first)
        no_links(d)
        with restored(base, to, "r") as r:
            expect(meshes(r, names) == want, "the restored daemon has other meshes")
            expect(len(r.ctl("jobs", "--json").ok().out.splitlines()) >= 6, "jobs are lost")
            # It is a whole daemon: it takes pushes, under names that the backup does not have.
            r.ctl("push", "a", tile(base, 900, n=400)).ok()
            expect(digests(r, "a", 1) == want["a", 1], "an old generation after a push")
        with restored(base, to, "r2") as r:
            expect(meshes(r, names) == want, "the backup is not what it was")


def again_and_again():
    """A second backup copies only new files, and removes files that are gone."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        names = fill(d, base)
        to = os.path.join(base, "backup")
        d.ctl("backup", to, "--copy").ok()
        before = files_of(to)
        d.ctl("push", "a", tile(base, 500, n=400)).ok()
        names["a"] = 2
        want = meshes(d, names)
        got = d.ctl("backup", to, "--json").ok().json()
        after = files_of(to)
        segments = {f for f in after if f.endswith(".seg")}
        expect(len(segments - set(before)) >= 1, "the new segment is not there")
        expect(all(after[f] == before[f] for f in segments & set(before)), "segments were brought again")
        expect(got["removed_files"] >= 1 and got["new_files"] < got["files"], got)
        with restored(base, to, "r") as r:
            expect(meshes(r, names) == want, "the second backup has other meshes")
        # A file of the same name and size with other bytes is brought again.
        victim = os.path.join(to, sorted(segments)[0])
        with open(victim, "r+b") as f:
            f.seek(100)
            f.write(b"\xff")
        d.ctl("backup", to).ok()
        with restored(base, to, "r2") as r:
            expect(meshes(r, names) == want, "a damaged file stayed in the backup")


def links_or_copies():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1, n=400)).ok()
        one, two = os.path.join(base, "one"), os.path.join(base, "two")
        expect(d.ctl("backup", one, "--json").ok().json()["linked_files"] > 0, "no hard links on one file system")
        expect(d.ctl("backup", two, "--copy", "--json").ok().json()["linked_files"] == 0, "--copy made links")
        for path, _, names in os.walk(two):
            expect(all(os.stat(os.path.join(path, n)).st_nlink == 1 for n in names), "--copy made links")
        shm = "/dev/shm/acut-backup-%d" % os.getpid()
        if os.path.isdir("/dev/shm") and os.stat("/dev/shm").st_dev != os.stat(base).st_dev:
            try:
                got = d.ctl("backup", shm, "--json").ok().json()
                expect(got["linked_files"] == 0 and got["new_files"] == got["files"], got)
            finally:
                shutil.rmtree(shm, ignore_errors=True)


def while_all_goes_on():
    """Pushes, jobs and backups at once: each backup is a consistent state."""
    with e2e.Folder() as base, e2e.Daemon(base, memory="64M") as d:
        n, failed = 12, []
        tiles = [tile(base, i, n=2000) for i in range(n)]
        d.ctl("push", "s", tiles[0]).ok()

        def push(some):
            for t in some:
                r = d.ctl("push", "s", t)
                if r.status:
                    failed.append(r.err)
                d.ctl("submit", "s")

        # Beside each backup two pushes, which are over before the next one.
        backups = []
        for i in range(1, n, 2):
            to = os.path.join(base, "backup%d" % len(backups))
            pusher = threading.Thread(target=push, args=(tiles[i:i + 2],))
            pusher.start()
            d.ctl("backup", to).ok()
            pusher.join()
            backups.append(to)
        expect(not failed, failed)
        seen = set()
        for i in (0, len(backups) // 2, len(backups) - 1):
            with restored(base, backups[i], "r%d" % i) as r:
                newest = r.ctl("dataset", "show", "s", "--json").ok().json()["generation"]
                seen.add(newest)
                expect(digests(r, "s", newest) == digests(d, "s", newest), "generation %d of backup %d" % (newest, i))
                expect(digests(r, "s", 1) == digests(d, "s", 1), "generation 1 of backup %d" % i)
        expect(len(seen) > 1, "all backups are of one moment")


def cut_short():
    """A killed client leaves the last backup usable, and nothing in the state."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        names = fill(d, base)
        want = meshes(d, names)
        to = os.path.join(base, "backup")
        d.ctl("backup", to).ok()
        gate = e2e.Gate(base)
        for k in range(4):
            d.ctl("push", "more%d" % k, tile(base, 700 + k, n=400)).ok()
            # Killed when the k-th of its files gets its name.
            gate.close("renameat", "/backup/", k)
            p = subprocess.Popen([e2e.ACUTCTL, "backup", to, "--copy"], env=dict(os.environ, ACUT_SOCKET=d.socket, **gate.env),
                                 stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            expect(gate.wait(lambda: p.poll() is not None), "it was over before it was killed")
            p.kill()
            p.wait()
            with restored(base, to, "r%d" % k) as r:
                expect(meshes(r, names) == want, "a backup that was cut short has harmed the last one")
        no_links(d)
        # And those that a killed daemon left.
        os.mkdir(os.path.join(d.state, "backup-7"))
        open(os.path.join(d.state, "backup-7", "list"), "w").close()
        d.stop(signal.SIGKILL)
        d.start()
        expect(not os.path.exists(os.path.join(d.state, "backup-7")), "the links of a crashed daemon stay behind")
        d.ctl("backup", to).ok()


def refused():
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1)).ok()
        d.ctl("push", "b", tile(base, 2)).ok()
        mine = os.path.join(base, "mine")
        os.mkdir(mine)
        open(os.path.join(mine, "thesis.txt"), "w").close()
        says(d.ctl("backup", mine), 2, "neither empty")
        says(d.ctl("dataset", "export", "a", mine), 2, "neither empty")
        expect(os.listdir(mine) == ["thesis.txt"], "something was written there")
        out = os.path.join(base, "out")
        d.ctl("dataset", "export", "a", out).ok()
        says(d.ctl("dataset", "export", "b", out), 2, "something else")
        says(d.ctl("backup", out), 2, "something else")
        # One whose mark says no more than that it is of a later day.
        def version(digit):
            with open(os.path.join(out, "acut-copy"), "r+b") as f:
                f.seek(len("acut copy "))
                f.write(digit)

        version(b"2")
        before = files_of(out)
        for command in (("dataset", "export", "a", out), ("backup", out)):
            says(d.ctl(*command), 76, "out", "written by a newer acutctl", "give another folder")
        expect(files_of(out) == before, "what a newer acutctl wrote is changed")
        version(b"1")
        d.ctl("dataset", "export", "a", out).ok()
        # The backup of another box stays what it is.
        theirs = os.path.join(base, "theirs")
        with e2e.Daemon(base, name="other") as other:
            other.ctl("push", "a", tile(base, 3)).ok()
            other.ctl("backup", theirs).ok()
        before = files_of(theirs)
        says(d.ctl("backup", theirs), 2, "theirs", "the backup of another store")
        expect(files_of(theirs) == before, "the backup of another store is changed")
        says(d.ctl("dataset", "export", "nothing", os.path.join(base, "x")), 4, "no dataset")
        says(d.ctl("dataset", "import", mine), 1, "no file manifest")
        says(d.ctl("dataset", "import", out, "a"), 1, "there is a dataset a already")
        says(d.ctl("dataset", "import", out, ".x"), 2, "cannot name a dataset")


def not_into_the_daemons_folders():
    """A backup into the state or cache of the daemon is refused, whatever path is given."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1)).ok()
        link = os.path.join(base, "link")
        os.symlink(d.state, link)
        for folder, word in ((d.state, "state"), (d.cache, "cache"), (link, "state"), (os.path.join(d.state, "datasets"), "state")):
            was = inodes_in(folder)
            says(d.ctl("backup", os.path.join(folder, "mine")), 2, "in the %s folder of the daemon" % word, "elsewhere")
            says(d.ctl("dataset", "export", "a", os.path.join(folder, "mine")), 2, "in the %s folder of the daemon" % word)
            no_links(d)  # The daemon's own, of what it was asked for: taken away once the client is gone.
            new = inodes_in(folder) - was
            expect(not new and not os.path.exists(os.path.join(folder, "mine")), "something stays behind: %s" % new)
        says(d.ctl("backup", d.cache), 2, "in the cache folder")
        deep = os.path.join(d.cache, "deep")
        os.mkdir(deep)
        says(d.ctl("backup", deep), 2, "in the cache folder")
        expect(os.listdir(deep) == [], "it was written to")
        # Beside them is no harm.
        d.ctl("backup", os.path.join(base, "cache-of-backups")).ok()


def another_of_the_same_name():
    """The folder of an export belongs to one dataset, not to its name."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        out = os.path.join(base, "out")
        d.ctl("push", "a", tile(base, 1)).ok()
        d.ctl("dataset", "export", "a", out).ok()
        d.ctl("push", "a", tile(base, 2)).ok()
        d.ctl("dataset", "export", "a", out).ok()
        held = files_of(out)
        # Removed and made again.
        d.ctl("dataset", "rm", "a").ok()
        d.ctl("push", "a", tile(base, 3)).ok()
        says(d.ctl("dataset", "export", "a", out), 2, "another dataset a", "give another folder")
        expect(files_of(out) == held, "the older export is changed")
        # The backup of another daemon.
        with e2e.Daemon(base, name="other") as other:
            other.ctl("push", "a", tile(base, 1)).ok()
            says(other.ctl("dataset", "export", "a", out), 2, "another dataset a")
        # Restored, it is itself again; a mark of before there were identities is taken by its name, as it was then.
        d.ctl("dataset", "rm", "a").ok()
        d.ctl("dataset", "restore", "1").ok()
        d.ctl("dataset", "export", "a", out).ok()
        mark = os.path.join(out, "acut-copy")
        with open(mark) as f:
            lines = f.readlines()
        expect(any(line.startswith("identity ") for line in lines), lines)
        with open(mark, "w") as f:
            f.writelines(line for line in lines if not line.startswith("identity "))
        d.ctl("dataset", "export", "a", out).ok()
        with open(mark) as f:
            expect("identity " in f.read(), "no identity from then on")


def restored_is_another():
    """A restored store gives out numbers again that were used after the backup. So it has another identity, and nothing that
    depends on the identity confuses the two."""
    with e2e.Folder() as base:
        to, older, out, own = (os.path.join(base, n) for n in ("backup", "older", "out", "own"))
        with e2e.Daemon(base) as d:
            d.ctl("push", "a", tile(base, 1)).ok()
            d.ctl("backup", to, "--copy").ok()
            shutil.copytree(to, older)
            d.ctl("push", "b", tile(base, 2)).ok()
            d.ctl("dataset", "export", "b", out).ok()
            d.ctl("backup", to, "--copy").ok()
        held, exported = files_of(to), files_of(out)
        with restored(base, older, "r") as r:
            # The same name and number.
            r.ctl("push", "b", tile(base, 3)).ok()
            says(r.ctl("backup", to), 2, "the backup of another store", "give another folder")
            says(r.ctl("dataset", "export", "b", out), 2, "another dataset b", "give another folder")
            expect(files_of(to) == held and files_of(out) == exported, "what the restored store has lost is overwritten")
            r.ctl("backup", own, "--copy").ok()
            # Once: a start is no restore.
            r.stop()
            r.start()
            r.ctl("backup", own, "--copy").ok()
        # Nor is it anything new to whom the backup was taken of.
        with e2e.Daemon(base) as d:
            d.ctl("backup", to, "--copy").ok()


def a_file_is_missing():
    """A missing file fails the backup, and is named."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1)).ok()
        folder = os.path.join(d.state, "datasets", "1")
        segment = [f for f in os.listdir(folder) if f.endswith(".seg")][0]
        os.rename(os.path.join(folder, segment), os.path.join(base, segment))
        says(d.ctl("backup", os.path.join(base, "b")), 75, "datasets/1/" + segment, "cache verify")
        says(d.ctl("dataset", "export", "a", os.path.join(base, "e")), 75, segment)
        os.rename(os.path.join(base, segment), os.path.join(folder, segment))
        d.ctl("backup", os.path.join(base, "b")).ok()


def a_manifest_is_damaged():
    """It is named. All else is in the backup, and so are all files of that dataset."""
    with e2e.Folder() as base:
        with e2e.Daemon(base) as d:
            d.ctl("push", "good", tile(base, 1)).ok()
            d.ctl("push", "bad", tile(base, 2)).ok()
            want = digests(d, "good")
            folders = os.path.join(d.state, "datasets")
            newest = sorted(os.listdir(folders), key=int)[-1]
            manifest = [n for n in os.listdir(os.path.join(folders, newest)) if n.startswith("manifest")][-1]
            with open(os.path.join(folders, newest, manifest), "r+b") as f:
                f.seek(40)
                byte = f.read(1)
                f.seek(40)
                f.write(bytes([byte[0] ^ 16]))
            to = os.path.join(base, "b")
            out = d.ctl("backup", to, "--json")
            says(out, 74, "datasets/%s/%s" % (newest, manifest))
            expect(json.loads(out.out.splitlines()[0])["files"] > 4, "the rest was not told to be there: %s" % out.out)
            kept = os.listdir(os.path.join(to, "datasets", newest))
            expect(any(n.endswith(".seg") for n in kept) and manifest in kept, "of the damaged dataset there is %s" % kept)
            no_links(d)
        with restored(base, to, "r") as r:
            expect(digests(r, "good") == want, "another mesh of the good one")


def a_state_is_no_backup():
    """A restored folder is the state of a daemon: a backup into it is refused."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1)).ok()
        to = os.path.join(base, "backup")
        d.ctl("backup", to).ok()
        with restored(base, to, "r") as r:
            r.ctl("push", "a", tile(base, 2)).ok()
            before = inodes_in(r.state)
            says(r.ctl("backup", r.state), 2, "in the state folder of the daemon")
            says(d.ctl("backup", r.state), 2, "the state of an acutd")
            no_links(r)
            new = inodes_in(r.state) - before
            expect(not new, f"something was written there: {new}")
        d.ctl("backup", to).ok()


def export_and_import():
    with e2e.Folder() as base, e2e.Daemon(base) as d, e2e.Daemon(base, name="2") as other:
        names = fill(d, base)
        want = meshes(d, names)
        for name, n in names.items():
            to = os.path.join(base, "out", name)
            os.makedirs(os.path.dirname(to), exist_ok=True)
            got = d.ctl("dataset", "export", name, to, "--json").ok().json()
            expect(got["dataset"] == name and got["files"] == len(os.listdir(to)) - 1, got)
            back = other.ctl("dataset", "import", to, "--json").ok().json()
            expect((back["dataset"], back["generation"]) == (name, n), back)
        expect(meshes(other, names) == want, "imported datasets have other meshes")
        # An exported one is pushed to as any other, twice imported are two.
        other.ctl("dataset", "import", os.path.join(base, "out", "c"), "c2").ok()
        other.ctl("push", "c", tile(base, 990, n=400)).ok()
        expect(digests(other, "c2", 3) == want["c", 3] == digests(other, "c", 3), "two imports of one export")
        # The files that it had are known.
        says(other.ctl("push", "c", os.path.join(base, "t00200.las")), 0, "there already")
        other.stop(signal.SIGKILL)
        other.start()
        expect(meshes(other, names) == want, "after a restart")


def damaged_imports():
    """A damaged export does not become a dataset, and leaves nothing on the disk."""
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1, n=3000)).ok()
        d.ctl("push", "a", tile(base, 2, n=3000)).ok()
        good = os.path.join(base, "good")
        d.ctl("dataset", "export", "a", good).ok()
        segments = sorted(f for f in os.listdir(good) if f.endswith(".seg"))
        before = sorted(os.listdir(os.path.join(d.state, "datasets")))
        size = os.path.getsize(os.path.join(good, segments[0]))
        bad = os.path.join(base, "bad")

        def tried(change, status, *texts):
            shutil.rmtree(bad, ignore_errors=True)
            shutil.copytree(good, bad)
            change()
            says(d.ctl("dataset", "import", bad, "x"), status, *texts)
            e2e.until(lambda: d.ctl("dataset", "show", "x").status == 4, "a dataset stays behind")
            e2e.until(lambda: sorted(os.listdir(os.path.join(d.state, "datasets"))) == before, "a folder stays behind")

        def flip(name, at):
            with open(os.path.join(bad, name), "r+b") as f:
                f.seek(at)
                byte = f.read(1)
                f.seek(at)
                f.write(bytes([byte[0] ^ 1]))

        tried(lambda: os.remove(os.path.join(bad, segments[1])), 1, "missing", segments[1])
        tried(lambda: os.truncate(os.path.join(bad, segments[0]), size - 16), 1, "the manifest says", segments[0])
        for at in (9, 200, 4096 + 9, 4096 + 100, size // 2, size - 40):
            tried(lambda: flip(segments[0], at), 74, segments[0] + ": ", "export the dataset again")
        tried(lambda: flip("manifest", 40), 74, "manifest")
        tried(lambda: shutil.copy(os.path.join(good, segments[0]), os.path.join(bad, "other.seg")), 1,
              "does not name")
        d.ctl("dataset", "import", good, "x").ok()


def rights():
    """Administrators may take backups; users who may read a dataset may export it."""
    if os.geteuid():
        print("     rights: skipped, it takes root to be another user")
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        os.chmod(base, 0o755)
        d.ctl("push", "--mode", "600", "a", tile(base, 1)).ok()
        os.chmod(d.socket, 0o666)
        place = os.path.join(base, "nobody")
        os.mkdir(place)
        os.chown(place, 65534, 65534)
        env = dict(os.environ, ACUT_SOCKET=d.socket)
        ctl = os.path.join(base, "acutctl")
        shutil.copy(e2e.ACUTCTL, ctl)
        for args in (["backup", place + "/b"], ["dataset", "export", "a", place + "/e"]):
            p = subprocess.run([ctl] + args, env=env, capture_output=True, user=65534, group=65534, extra_groups=[], cwd="/")
            expect(p.returncode == 77, "%s ended with %d: %s" % (args, p.returncode, p.stderr))


def left_at_once():
    """Clients that leave before they get their file leak nothing in the daemon."""
    try:
        from acut_wire import Client, pb
    except ImportError as e:
        print("     left_at_once: skipped: %s" % e)
        return
    with e2e.Folder() as base, e2e.Daemon(base) as d:
        d.ctl("push", "a", tile(base, 1)).ok()
        fds = "/proc/%d/fd" % d.process.pid
        open_files = lambda: sorted(os.readlink(os.path.join(fds, n)) for n in ("0", "1", "2"))
        before = open_files()
        for i in range(60):
            with Client(d.socket) as c:
                m = pb.Message()
                m.backup.CopyFrom(pb.Backup())
                c.wire.send(100, m)
                ready = c.wire.recv()[1].backup_ready
                for n in range(i % 3):
                    m = pb.Message()
                    m.backup_next.CopyFrom(pb.BackupNext(backup=ready.backup))
                    c.wire.send(200 + n, m)
                    os.close(c.wire.recv()[2])
                m = pb.Message()
                m.backup_next.CopyFrom(pb.BackupNext(backup=ready.backup))
                c.wire.send(300, m)
        no_links(d)
        expect(open_files() == before, "the daemon had %s open, and now %s" % (before, open_files()))
        d.ctl("backup", os.path.join(base, "b")).ok()
        says(d.ctl("cache", "verify"), 0)


if __name__ == "__main__":
    e2e.main(left_at_once, whole_state, again_and_again, links_or_copies, while_all_goes_on, cut_short, refused, not_into_the_daemons_folders,
             another_of_the_same_name, restored_is_another, a_file_is_missing, a_manifest_is_damaged, a_state_is_no_backup, export_and_import, damaged_imports, rights)
