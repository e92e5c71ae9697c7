"""Files of other users: their owner changes them while they are read, and symbolic links that others made."""
import json
import mmap
import os
import shutil
import time

import e2e
from e2e import Folder, expect
from rights import CARL, OTHERS, Box, main_as_root


def passed_descriptors():
    """Files that their owner writes to, truncates or maps while they are read: an error or consistent bytes, never a crash of the
    daemon. Points that were read do not change afterwards."""
    with Folder() as base:
        gate = e2e.Gate(base)
        with Box(base, env=gate.env) as box:
            passed_descriptors_of(box, gate, base)


def passed_descriptors_of(box, gate, base):
    for how, reads, says in [(how, reads, says) for how in ("truncated", "written", "mapped", "opened again")
                             for reads, says in ((0, "after its header was read"), (12, "while it was read"))]:
        name = "%s-%d" % (how.split()[0], reads)
        path = os.path.join(base, name + ".las")
        shutil.copy(box.survey(200000), path)
        os.chmod(path, 0o666)
        size = os.path.getsize(path)
        # First when some of it was read and more is wanted, then while the push goes on.
        gate.close("pread", "/%s.las" % name, reads, "acutd")
        p = box.start("anna", "push", name, path)
        expect(gate.wait(lambda: p.poll() is not None), "%s: it was not read" % how)
        with open(path, "r+b") as f:
            m = mmap.mmap(f.fileno(), size) if how == "mapped" else None
            end = None
            while p.poll() is None and (not end or time.monotonic() < end):
                if how == "truncated":
                    f.truncate(5000)
                    time.sleep(0.002)
                    f.truncate(size)
                elif how == "mapped":
                    m[size // 2:size // 2 + 64] = os.urandom(64)
                elif how == "opened again":
                    with open(path, "r+b") as again:
                        again.seek(size // 3)
                        again.write(b"\xff" * 4096)
                else:
                    f.seek(375 + (size // 2) // 30 * 30)
                    f.write(os.urandom(30))
                    f.flush()
                gate.open()
                end = end or time.monotonic() + 0.5
            if m:
                m.close()
        out, err = p.communicate(timeout=e2e.PATIENCE)
        # Of a mapped one not every file system says that it changed.
        expect(p.returncode == 1 or (how == "mapped" and p.returncode in (0, 3)), "%s: %d %s" % (how, p.returncode, err))
        expect(how in ("truncated", "mapped") or says in err.decode(), "%s: %s, not %s" % (name, err, says))
        box.daemon.ctl("ping").ok()
    path = shutil.copy(box.survey(20000), os.path.join(base, "taken.las"))
    box.good("anna", "push", "taken", path)
    first = json.loads(box.good("anna", "submit", "taken", "--wait", "--new", "--json"))["digest"]
    os.truncate(path, 0)
    second = json.loads(box.good("anna", "submit", "taken", "--wait", "--new", "--json"))["digest"]
    expect(first == second, "what was taken changed")
    # The other way: what the daemon hands out cannot be written to.
    try:
        from acut_wire import Client, pb
    except ImportError as e:
        print("     what is handed out: skipped: %s" % e)
        return
    box.good("anna", "push", "kept", box.survey())
    with Client(box.daemon.socket) as c:
        m = pb.Message()
        m.backup.CopyFrom(pb.Backup(dataset="kept"))
        c.wire.send(100, m)
        ready = c.wire.recv()[1].backup_ready
        n = 0
        while True:
            m = pb.Message()
            m.backup_next.CopyFrom(pb.BackupNext(backup=ready.backup))
            c.wire.send(101 + n, m)
            _, answer, fd = c.wire.recv()
            if answer.backup_file.last:
                break
            for wrong in (lambda: os.write(fd, b"x"), lambda: os.ftruncate(fd, 0)):
                try:
                    wrong()
                    expect(False, "a file of the state can be written to")
                except OSError:
                    pass
            os.close(fd)
            n += 1
        expect(n > 0, "nothing was handed out")


def links_of_others():
    """In a sticky folder that everybody may write into, the target of a link of another user is never overwritten, not even by
    root."""
    with Folder() as base, Box(base) as box:
        good = box.survey()
        shared, mine = os.path.join(base, "shared"), os.path.join(base, "mine")
        os.mkdir(shared)
        os.chmod(shared, 0o1777)
        os.mkdir(mine)
        treasure = os.path.join(mine, "treasure")
        with open(treasure, "w") as f:
            f.write("kept")
        for name, to in (("out.ply", treasure), ("tiles", mine + "/tiles"), ("drop", mine), ("up", mine), ("deep", mine)):
            os.symlink(to, os.path.join(shared, name))
            os.lchown(os.path.join(shared, name), CARL, OTHERS)
        e2e.run([box.acutctl, "push", "a", good], env={"ACUT_SOCKET": box.daemon.socket}).ok()
        job = e2e.run([box.acutctl, "submit", "a", "--wait", "--json"], env={"ACUT_SOCKET": box.daemon.socket}).ok().json()["job"]
        # "@" stands for the shared folder.
        for words in (("mesh", good, "-o", "@/out.ply"), ("fetch", job, "-o", "@/out.ply"), ("fetch", job, "-o", "@/out.ply", "--resume"),
                      ("fetch", job, "-o", "@/deep/x.ply"), ("fetch", job, "-o", "@/deep/x.ply", "--resume"),
                      ("fetch", job, "--tile", 100, "-o", "@/tiles/"), ("backup", "@/up/backup"), ("backup", "@/tiles"),
                      ("dataset", "export", "a", "@/up/export"), ("ingest", "a", "@/drop"), ("metrics", "--textfile", "@/up/m.prom")):
            status, out, err = box.ask("root", *[str(w).replace("@", shared) for w in words])
            expect(status == 77 and "is a link that the user with id %d" % CARL in err and "hint: " in err, "%s: %d %s %s" % (words, status, out, err))
        expect(os.listdir(mine) == ["treasure"] and open(treasure).read() == "kept", "%s" % os.listdir(mine))
        # His own he may.
        os.lchown(os.path.join(shared, "out.ply"), 0, 0)
        status, out, err = box.ask("root", "fetch", job, "-o", os.path.join(shared, "out.ply"))
        expect(status == 0 and os.path.islink(os.path.join(shared, "out.ply")) and os.path.getsize(treasure) > 1000, "%d %s" % (status, err))


if __name__ == "__main__":
    main_as_root(passed_descriptors, links_of_others)
