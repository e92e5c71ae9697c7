"""The limits of one user: exports, jobs, disk, connections and memory."""
import json
import os
import socket
import sys
import threading
import time

import e2e
from e2e import Folder, expect
from rights import ADMINS, ANNA, CARL, GIS, GROUPS, Box, become, main_as_root


def limit_of_exports():
    """Open exports: one user may have two, and administrators always get one."""
    try:
        from acut_wire import Wire, pb
    except ImportError as e:
        print("     skipped: %s" % e)
        return
    with Folder() as base, Box(base, args=GROUPS) as box:
        box.good("anna", "push", "--mode", "644", "d", box.survey())
        place = os.path.join(base, "out")
        os.mkdir(place)
        os.chmod(place, 0o777)
        parent, there = socket.socketpair()
        there.settimeout(e2e.PATIENCE)
        for who, want in (("carl", [0, 0, 1]), ("bert, in the group by his first one", [0, 1, 1])):
            child = os.fork()
            if not child:
                code = 1
                try:
                    become(who)
                    wire, got = Wire(box.daemon.socket), []
                    for n, (body, value) in enumerate([("hello", pb.Hello(version_min=1, version_max=1))] +
                                                      3 * [("backup", pb.Backup(dataset="d"))]):
                        m = pb.Message()
                        getattr(m, body).CopyFrom(value)
                        wire.send(n + 1, m)
                        got.append(int(wire.recv()[1].error.code == "busy"))
                    code = got[1:] != want
                    there.sendall(b"x")
                    there.recv(1)
                finally:
                    os._exit(code)
            parent.settimeout(e2e.PATIENCE)
            parent.recv(1)
            if who == "carl":
                first = child
        box.good("an administrator", "dataset", "export", "d", place + "/d")
        parent.sendall(b"xx")
        for n in (first, child):
            expect(os.waitstatus_to_exitcode(os.waitpid(n, 0)[1]) == 0, "exports that are open")


def limit_of_jobs():
    with Folder() as base:
        gate = e2e.Gate(base)
        with Box(base, memory="64M", args=("--user-jobs", "3", "--admin-group", str(ADMINS)), env=gate.env) as box:
            limit_of_jobs_in(box, gate)


def limit_of_jobs_in(box, gate):
    box.good("anna", "push", "--mode", "666", "d", box.survey(20000))
    # Reading the survey is held: no job ends before the fourth is submitted.
    gate.close("pread", ".seg")
    mine = [box.good("anna", "submit", "d", "--new", "--every", i + 2).split()[0] for i in range(3)]
    p = box.start("anna", "submit", "d", "--new", "--every", "9")
    out, err = p.communicate(timeout=e2e.PATIENCE)
    expect(p.returncode == 1 and b"3 jobs" in err and b"user-jobs" in err, "%d %s" % (p.returncode, err))
    expect("uid %d, pid %d" % (ANNA, p.pid) in box.log(), "log: %s" % box.log())
    # The same job again is no new one; others, and administrators, are not held by it.
    box.good("carl", "submit", "d")
    for i in range(4):
        box.good("an administrator", "submit", "d", "--new", "--every", i + 3)
    box.good("anna", "cancel", mine[0])
    gate.open()
    box.good("anna", "wait", mine[1])
    box.good("anna", "submit", "d", "--new", "--every", "10")


def limit_of_disk():
    with Folder() as base, Box(base, args=("--user-disk", "1M", "--admin-group", str(ADMINS))) as box:
        box.good("anna", "push", "a", box.survey(20000))
        p = box.start("anna", "push", "b", box.survey(20000, seed=2))
        out, err = p.communicate(timeout=e2e.PATIENCE)
        expect(p.returncode == 1 and b"user-disk" in err and b"1" in err, "%d %s" % (p.returncode, err))
        expect("uid %d, pid %d" % (ANNA, p.pid) in box.log(), "log: %s" % box.log())
        # The push goes with its connection, and the dataset that it made with the push: soon after the client has ended.
        e2e.until(lambda: box.ask("anna", "dataset", "show", "b")[0] == 4, "something of it stays")
        box.good("anna", "push", "b", box.survey(300))
        # Others have their own; administrators no limit.
        box.good("carl", "push", "c", box.survey(20000, seed=2))
        for i in range(2):
            box.good("an administrator", "push", "big%d" % i, box.survey(30000, seed=3 + i))
        # The data of a dataset counts for its owner.
        box.good("root", "dataset", "chown", ANNA, "big0")
        status, _, err = box.ask("anna", "push", "b", box.survey(20000, seed=5))
        expect(status == 1 and "user-disk" in err, "what she was given does not count: %d %s" % (status, err))
        box.good("root", "dataset", "chown", CARL, "a")
        box.good("root", "dataset", "chown", CARL, "big0")
        box.good("anna", "push", "e", box.survey(20000, seed=5))


def limit_of_connections():
    with Folder() as base, Box(base, args=("--user-connections", "4", "--admin-group", str(ADMINS))) as box:
        ready, go = os.pipe(), os.pipe()
        child = os.fork()
        if not child:
            code = 1
            try:
                os.setgroups([])
                os.setgid(GIS)
                os.setuid(ANNA)
                held, busy = [], 0
                for i in range(60):
                    s = socket.socket(socket.AF_UNIX)
                    s.connect(box.daemon.socket)
                    s.settimeout(e2e.PATIENCE if i >= 4 else 0.05)
                    try:
                        got = s.recv(4096)
                        busy += b"user-connections" in got and b"busy" in got and s.recv(1) == b""
                        s.close()
                    except socket.timeout:
                        held.append(s)
                code = 0 if (len(held), busy) == (4, 56) else 3
                if code:
                    sys.stderr.write("     %d held, %d busy\n" % (len(held), busy))
                os.write(ready[1], b"x")
                os.read(go[0], 1)
            finally:
                os._exit(code)
        os.read(ready[0], 1)
        status, _, err = box.ask("anna", "ping")
        expect(status == 75 and "user-connections" in err, "%d %s" % (status, err))
        for who in ("carl", "root"):
            box.good(who, "ping")
        held = [box.start("an administrator", "watch") for _ in range(7)]
        time.sleep(0.3)
        box.good("an administrator", "ping")
        for p in held:
            p.kill()
            p.wait()
        count = box.daemon.ctl("status", "--json").ok().json()
        expect(len([h for h in count["holders"] if h["uid"] == ANNA]) == 4, "%s" % count["holders"])
        expect("uid %d" % ANNA in box.log(), "log: %s" % box.log())
        os.write(go[1], b"x")
        expect(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, "surplus connections")
        deadline = time.monotonic() + e2e.PATIENCE
        while box.ask("anna", "ping")[0] and time.monotonic() < deadline:
            time.sleep(0.05)
        box.good("anna", "ping")


def limit_of_memory():
    """The jobs of one user hold no more than the user's share of the memory, one after the other if necessary; the mesh is the
    same. A job that can never fit is refused, with the number."""
    with Folder() as base:
        gate = e2e.Gate(base)
        with Box(base, memory="96M", args=("--user-memory", "25%", "--admin-group", str(ADMINS)), env=gate.env) as box:
            limit_of_memory_in(box, gate)
    with Folder() as base, Box(base, memory="32M", args=("--user-memory", "4%", "--admin-group", str(ADMINS))) as box:
        box.good("root", "push", "d", box.survey(20000))
        status, _, err = box.ask("anna", "submit", "d", "--wait")
        expect(status == 1 and "user-memory" in err and "%" in err, "%d %s" % (status, err))
        status, _, err = box.ask("anna", "push", "e", box.survey(20000))
        expect(status == 1 and "user-memory" in err, "%d %s" % (status, err))
        expect("uid %d" % ANNA in box.log(), "log: %s" % box.log())
        box.good("root", "submit", "d", "--wait")


def limit_of_memory_in(box, gate):
    survey = box.survey(300000)
    box.good("anna", "push", "--mode", "644", "d", survey)
    want = json.loads(box.good("an administrator", "submit", "d", "--wait", "--json"))["digest"]
    box.daemon.ctl("cache", "gc", "--all").ok()  # hers are made again
    most, over = 0, threading.Event()

    def look():
        nonlocal most
        while not over.is_set():
            holders = box.daemon.ctl("status", "--json").json()["holders"]
            most = max(most, sum(sum(h["held"].values()) for h in holders if h["uid"] == ANNA and h["kind"] in ("job", "push", "plan", "fetch")))
            time.sleep(0.01)
    watcher = threading.Thread(target=look)
    watcher.start()
    try:
        # What is held is looked at while somebody holds it, at least once.
        gate.close("renameat", "/domains/")
        many = [box.good("anna", "submit", "d", "--new").split()[0] for _ in range(3)]
        e2e.until(lambda: most, "nobody is seen to hold anything")
        gate.open()
        push = box.start("anna", "push", "e", box.survey(200000, seed=2))
        got = [json.loads(box.good("anna", "wait", n, "--json").splitlines()[-1]) for n in many]
        out, err = push.communicate(timeout=e2e.PATIENCE)
    finally:
        over.set()
        watcher.join()
    expect(push.returncode == 0, "push: %s" % err)
    expect([g["digest"] for g in got] == [want] * 3, "digests: %s, not %s" % (got, want))
    share = 96 * 2**20 * 0.25
    print("     one user held %.1f of %.1f MiB" % (most / 2**20, share / 2**20))
    expect(0 < most <= share, "%d bytes, more than %d" % (most, share))


if __name__ == "__main__":
    main_as_root(limit_of_exports, limit_of_jobs, limit_of_disk, limit_of_connections, limit_of_memory)
