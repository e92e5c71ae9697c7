"""Permissions: users and groups as the kernel reports them (setpriv; the numbers need no accounts), with datasets of all modes,
jobs of others, and the settings group and admin-group."""
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time

import e2e
from e2e import Daemon, Folder, expect

ANNA, BERT, CARL, ADMIN, NOBODY = 3001, 3002, 3003, 3009, 3099
USERS, GIS, OTHERS, ADMINS = 5000, 5100, 5200, 5001  # groups: served; of the dataset; of nothing; admin-group
# The clients: user, first group, other groups.
WHO = {
    "anna": (ANNA, GIS, (USERS,)),
    "anna, now in other groups": (ANNA, OTHERS, (USERS,)),
    "bert, in the group by a supplementary one": (BERT, OTHERS, (USERS, GIS)),
    "bert, in the group by his first one": (BERT, GIS, (USERS,)),
    "carl": (CARL, OTHERS, (USERS,)),
    "carl, served by his first group": (CARL, USERS, ()),
    "an administrator": (ADMIN, OTHERS, (USERS, ADMINS)),
    "an administrator by first group": (ADMIN, ADMINS, ()),
    "root": (0, 0, ()),
}
GROUP = {"bert, in the group by a supplementary one", "bert, in the group by his first one"}
ALL = {"an administrator", "an administrator by first group", "root"}
OWNER = {"anna", "anna, now in other groups"}


def become(who):
    """Makes this process that user: a row of WHO, or (user, first group, other groups)."""
    uid, gid, groups = WHO[who] if isinstance(who, str) else who
    os.setgroups(groups)
    os.setgid(gid)
    os.setuid(uid)


class Box:
    """A daemon that other users can connect to, and an acutctl that they can run."""

    def __init__(self, base, **kw):
        os.chmod(base, 0o755)
        self.base, self.daemon = base, Daemon(base, **kw)
        self.acutctl = shutil.copy(e2e.ACUTCTL, base)
        self.files = {}

    def __enter__(self):
        os.umask(0o022)
        self.daemon.start()
        os.chmod(self.daemon.socket, 0o666)
        return self

    def __exit__(self, *exc):
        self.daemon.__exit__(*exc)

    def survey(self, points=300, seed=1):
        path = os.path.join(self.base, "survey-%d-%d.las" % (points, seed))
        if not os.path.exists(path):
            e2e.run([e2e.SYNTH, "--points", points, "--density", 2, "--seed", seed, path]).ok()
            os.chmod(path, 0o644)
        return path

    def command(self, who, *args):
        uid, gid, more = WHO[who] if isinstance(who, str) else who
        return ["setpriv", "--reuid", str(uid), "--regid", str(gid)] + (
            ["--groups", ",".join(map(str, more))] if more else ["--clear-groups"]) + [self.acutctl] + [str(a) for a in args]

    def ask(self, who, *args, umask=0o022, timeout=e2e.PATIENCE):
        p = subprocess.run(self.command(who, *args), env=dict(os.environ, ACUT_SOCKET=self.daemon.socket), cwd=self.base,
                           stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=timeout,
                           preexec_fn=lambda: os.umask(umask))
        return p.returncode, p.stdout.decode(), p.stderr.decode()

    def good(self, who, *args, **kw):
        status, out, err = self.ask(who, *args, **kw)
        expect(status == 0, "%s: %s: %d %s" % (who, args, status, err))
        return out

    def start(self, who, *args):
        return subprocess.Popen(self.command(who, *args), env=dict(os.environ, ACUT_SOCKET=self.daemon.socket), cwd=self.base,
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def log(self):
        return self.daemon.log_text()


GROUPS = ("--group", str(USERS), "--admin-group", str(ADMINS))


def datasets():
    """All users, operations and modes: permitted is what a file of that owner, group and mode would permit."""
    n = 0
    with Folder() as base, Box(base, args=GROUPS) as box:
        survey, place = box.survey(), os.path.join(base, "out")
        os.mkdir(place)
        os.chmod(place, 0o777)
        box.good("anna", "push", "d", survey, umask=0o027)
        shown = json.loads(box.good("anna", "dataset", "show", "d", "--json"))
        expect((shown["uid"], shown["gid"], shown["mode"]) == (ANNA, GIS, "0640"), "%s" % shown)
        box.good("anna", "push", "d", box.survey(seed=2))
        for mode in (0o000, 0o640, 0o660, 0o606, 0o046):
            box.good("anna", "dataset", "chmod", "%o" % mode, "d")
            for who in WHO:
                cls = mode >> 6 if who in OWNER else mode >> 3 if who in GROUP else mode
                read, write = (True, True) if who in ALL else (bool(cls & 4), bool(cls & 2))
                listed = "d" in [json.loads(line)["name"] for line in box.good(who, "datasets", "--json").splitlines()]
                expect(listed == read, "%s lists %s of mode %o" % (who, listed, mode))
                for may, args in ((read, ("dataset", "show", "d")), (read, ("plan", "d")), (read, ("dataset", "log", "d", "--files")),
                                  (write, ("push", "d", survey))):
                    status, out, err = box.ask(who, *args)
                    # A file that is there already is no error.
                    good = status in (0, 3)
                    expect(good if may else status == 77 and "mode" in err, "%s, mode %o: %s: %d %s" % (who, mode, args, status, err))
                    n += 1
        # What reads and writes most, for one mode each.
        box.good("anna", "dataset", "chmod", "u=rw,g=r,o=", "d")
        for i, who in enumerate(WHO):
            may = who in ALL | OWNER | GROUP
            for args in (("submit", "d", "--wait", "--new"), ("dataset", "export", "d", place + "/%d" % i)):
                status, _, err = box.ask(who, *args)
                expect(status == (0 if may else 77), "%s: %s: %d %s" % (who, args, status, err))
                n += 1
            status, _, err = box.ask(who, "dataset", "revert", "d")
            expect(status == (0 if who in ALL | OWNER else 77), "%s reverts: %d %s" % (who, status, err))
            n += 1
    print("     %d answers as a file's" % n)


def owners():
    """Operations of the owner only, whatever the mode, and to whom a dataset may be given."""
    with Folder() as base, Box(base, args=GROUPS) as box:
        box.good("anna", "push", "d", box.survey())
        box.good("anna", "dataset", "chmod", "666", "d")
        others = [w for w in WHO if w not in ALL | OWNER]
        for who in others:
            for args in (("dataset", "rm", "d"), ("dataset", "pin", "d"), ("dataset", "unpin", "d"), ("dataset", "chmod", "600", "d"),
                         ("dataset", "chgrp", USERS, "d"), ("dataset", "chown", BERT, "d"), ("dataset", "prune", "d", "--keep", "1"),
                         ("dataset", "discard", "d", "--all")):
                status, _, err = box.ask(who, *args)
                expect(status == 77, "%s: %s: %d %s" % (who, args, status, err))
        for who in ("anna", "an administrator", "root"):
            for args in (("dataset", "pin", "d"), ("dataset", "unpin", "d"), ("dataset", "chmod", "g-w,o=r", "d"), ("dataset", "rm", "d"),
                         ("dataset", "restore", "d"), ("dataset", "prune", "d", "--keep", "1"), ("dataset", "discard", "d", "--all")):
                box.good(who, *args)
            if who == "anna":
                box.good(who, "dataset", "rm", "d")
                status, _, err = box.ask("carl", "dataset", "restore", "d")
                expect(status == 4, "carl restores: %d %s" % (status, err))
                expect(box.good("carl", "datasets", "--removed", "--json") == "", "carl sees what anna removed")
                box.good(who, "dataset", "restore", "d")
        # A group that she is in, by the first or another one; not any. Another owner: no.
        box.good("anna", "dataset", "chgrp", USERS, "d")
        for args in (("dataset", "chgrp", OTHERS, "d"), ("dataset", "chown", BERT, "d"), ("dataset", "chown", ANNA, "d")):
            status, _, err = box.ask("anna", *args)
            expect(status == 77, "anna: %s: %d %s" % (args, status, err))
        box.good("an administrator", "dataset", "chgrp", OTHERS, "d")
        box.good("an administrator", "dataset", "chown", BERT, "d")
        shown = json.loads(box.good("root", "dataset", "show", "d", "--json"))
        expect((shown["uid"], shown["gid"], shown["mode"]) == (BERT, OTHERS, "0644"), "%s" % shown)
        status, _, err = box.ask("anna", "dataset", "rm", "d")
        expect(status == 77, "she gave it away: %d %s" % (status, err))
        for wrong in ("888", "1777", "rw", "u+rwx,", "640x", "u+s"):
            status, _, err = box.ask("root", "dataset", "chmod", wrong, "d")
            expect(status == 2 and "mode" in err, "%s: %d %s" % (wrong, status, err))
        # It is so after a restart, and what is there before anybody pushes has all of it, too.
        box.good("anna", "dataset", "create", "early", "--mode", "g+w")
        box.good("anna", "push", "--mode", "600", "own", box.survey())
        box.good("anna", "push", "open", box.survey(), umask=0)
        box.daemon.stop()
        box.daemon.start()
        os.chmod(box.daemon.socket, 0o666)
        rows = {d["name"]: d for d in map(json.loads, box.good("root", "datasets", "--json").splitlines())}
        expect([(rows[k]["uid"], rows[k]["gid"], rows[k]["mode"]) for k in ("d", "early", "own", "open")] ==
               [(BERT, OTHERS, "0644"), (ANNA, GIS, "0660"), (ANNA, GIS, "0600"), (ANNA, GIS, "0666")], "%s" % rows)
        # An import is the importer's.
        place = os.path.join(base, "export")
        box.good("root", "dataset", "export", "d", place)
        for folder, _, names in os.walk(place):
            os.chmod(folder, 0o755)
            for name in names:
                os.chmod(os.path.join(folder, name), 0o644)
        box.good("carl", "dataset", "import", place, "copy", umask=0o077)
        shown = json.loads(box.good("carl", "dataset", "show", "copy", "--json"))
        expect((shown["uid"], shown["gid"], shown["mode"]) == (CARL, OTHERS, "0600"), "%s" % shown)


def jobs():
    """Users have access to their own jobs, administrators to all, whoever owns the dataset."""
    with Folder() as base, Box(base, args=GROUPS) as box:
        box.good("anna", "push", "d", box.survey())
        anna = box.good("anna", "submit", "d", "--wait").split()[0]
        carl = box.good("carl", "submit", "d", "--wait").split()[0]
        expect(anna != carl, "a job of another one is given to carl")
        seen = lambda who: {str(json.loads(line)["job"]) for line in box.good(who, "jobs", "--json").splitlines()}
        for who, want in (("anna", {anna}), ("carl", {carl}), ("bert, in the group by his first one", set()),
                          ("an administrator", {anna, carl}), ("an administrator by first group", {anna, carl}), ("root", {anna, carl})):
            expect(seen(who) == want, "%s sees %s" % (who, seen(who)))
        for args in (("show", anna), ("wait", anna), ("cancel", anna), ("fetch", anna, "-o", "/dev/null", "--format", "null"), ("rm", anna),
                     ("watch", anna)):
            status, _, err = box.ask("carl", *args)
            expect(status == 4 and "no job" in err, "carl: %s: %d %s" % (args, status, err))
        box.good("an administrator", "show", anna)
        status, _, err = box.ask("anna", "submit", "d", "--priority", "high", "--new")
        expect(status == 77, "priority: %d %s" % (status, err))
        box.good("an administrator", "submit", "d", "--priority", "high", "--wait")
        # Submitted jobs go on, even if the mode changes.
        box.good("anna", "dataset", "chmod", "600", "d")
        box.good("carl", "fetch", carl, "--format", "null")
        status, _, err = box.ask("carl", "submit", "d", "--new")
        expect(status == 77, "submit: %d %s" % (status, err))
        # An administrator ends the job of another one; one without a dataset of its own is not seen by name either.
        box.good("an administrator", "rm", anna)
        expect(seen("anna") == set(), "it is still there")
        for args in (("backup", base + "/b"), ("cache", "gc"), ("cache", "verify")):
            status, _, err = box.ask("anna", *args)
            expect(status == 77, "anna: %s: %d %s" % (args, status, err))
            if args[0] == "cache":
                box.good("an administrator", *args)


def served():
    """The setting group: other users are told so and disconnected. The log names them, and is not flooded."""
    nobody, begun = (NOBODY, OTHERS, ()), time.monotonic()
    with Folder() as base, Box(base, args=GROUPS) as box:
        for who in WHO:
            box.good(who, "ping")
        p = box.start(nobody, "ping")
        out, err = p.communicate(timeout=e2e.PATIENCE)
        expect(p.returncode == 77 and str(USERS) in err.decode(), "%d %s" % (p.returncode, err))
        line = [l for l in box.log().splitlines() if "uid %d, pid %d" % (NOBODY, p.pid) in l]
        expect(len(line) == 1 and "group" in line[0], "log: %s" % box.log())
        # The error comes however the client and the daemon meet, and nothing of them stays.
        child = os.fork()
        if not child:
            code = 1
            try:
                os.setgroups([])
                os.setgid(OTHERS)
                os.setuid(NOBODY)
                for i in range(400):
                    s = socket.socket(socket.AF_UNIX)
                    s.connect(box.daemon.socket)
                    try:
                        if i % 2:
                            s.sendall(b"AC" + b"\0" * 30)
                    except OSError:
                        pass
                    got = b""
                    while True:
                        try:
                            part = s.recv(4096)
                        except ConnectionResetError:
                            break  # what was sent is not read any more
                        if not part:
                            break
                        got += part
                    assert b"not-permitted" in got and got[:2] == b"AC", got
                    s.close()
                code = 0
            except BaseException as e:
                sys.stderr.write("     %r\n" % e)
            finally:
                os._exit(code)
        expect(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, "a refusal that did not come")
        told = [l for l in box.log().splitlines() if "uid %d" % NOBODY in l]
        # Twenty in each half minute since the first.
        most = 20 * (1 + int((time.monotonic() - begun) / 30))
        expect(2 <= len(told) <= most, "%d lines, and %d at most" % (len(told), most))
        e2e.until(lambda: box.daemon.ctl("status", "--json").ok().json()["connections"] == 1, "who was refused stays connected")
    # Without a group everybody who can connect to the socket is served.
    with Folder() as base, Box(base) as box:
        box.good(nobody, "push", "mine", box.survey())
        status, _, err = box.ask((ADMIN, ADMINS, ()), "dataset", "rm", "mine")
        expect(status == 77, "without an admin-group: %d %s" % (status, err))


def many_groups():
    """A process in as many groups as possible: all count, and the memory for them is charged to the connection."""
    try:
        most = int(open("/proc/sys/kernel/ngroups_max").read())
    except OSError:
        most = 65536
    groups = list(range(100000, 100000 + most - 1)) + [GIS]
    with Folder() as base, Box(base) as box:
        box.good("anna", "push", "--mode", "640", "d", box.survey())
        parent, there = socket.socketpair()
        child = os.fork()
        if not child:
            code = 1
            try:
                become((BERT, OTHERS, groups))
                held = []
                for i in range(3):
                    s = socket.socket(socket.AF_UNIX)
                    s.connect(box.daemon.socket)
                    held.append(s)
                env = dict(os.environ, ACUT_SOCKET=box.daemon.socket)
                code = subprocess.run([box.acutctl, "dataset", "show", "d"], env=env, stdout=subprocess.DEVNULL).returncode
                there.sendall(b"x")
                there.recv(1)
            finally:
                os._exit(code)
        parent.settimeout(e2e.PATIENCE)
        parent.recv(1)
        rows = lambda: [h for h in box.daemon.ctl("status", "--json").ok().json()["holders"] if h["kind"] == "connection" and h["uid"] == BERT]
        e2e.until(lambda: len(rows()) == 3, lambda: "holders: %s" % rows())  # acutctl has left
        expect(all(sum(h["held"].values()) >= 4 * most for h in rows()), "holders: %s" % rows())
        parent.sendall(b"x")
        expect(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, "of %d groups the last does not count" % most)


def peer_of_the_socket():
    """A connection belongs to the user who made it, also if root has it later and its maker is gone, whose pid may be
    another's."""
    try:
        import acut_wire
        from acut_wire import pb
    except ImportError as e:
        print("     skipped: %s" % e)
        return
    with Folder() as base, Box(base, args=GROUPS) as box:
        box.good("anna", "push", "--mode", "600", "d", box.survey())
        wire = acut_wire.Wire.__new__(acut_wire.Wire)
        wire.timeout, wire.sock = e2e.PATIENCE, socket.socket(socket.AF_UNIX)
        child = os.fork()
        if not child:
            become("carl")
            wire.sock.connect(box.daemon.socket)
            os._exit(0)
        os.waitpid(child, 0)
        wire.sock.settimeout(e2e.PATIENCE)
        for n, (body, value) in enumerate((("hello", pb.Hello(version_min=1, version_max=1)), ("datasets_request", pb.DatasetsRequest(name="d")))):
            m = pb.Message()
            getattr(m, body).CopyFrom(value)
            wire.send(n + 1, m)
            answer = wire.recv()[1]
        expect(answer.error.code == "not-permitted", "%s" % answer)
        expect("uid %d, pid %d" % (CARL, child) in box.log(), "log: %s" % box.log())
        wire.close()


def rights_of_open_connections():
    """A reload applies to open connections: clients that are no longer served are told so and disconnected; others continue, with
    or without the rights of administrators. A setting with an error changes nothing."""
    try:
        import acut_wire
        from acut_wire import pb
        from config import Configured
    except ImportError as e:
        print("     skipped: %s" % e)
        return
    served = "group = %d\nadmin-group = %d\nuser-connections = 5\n" % (USERS, ADMINS)
    with Folder() as base:
        box = Box(base)
        box.daemon = Configured(base, served)
        with box:
            box.good("anna", "push", "--mode", "600", "d", box.survey())

            def connect(who):
                wire = acut_wire.Wire.__new__(acut_wire.Wire)
                wire.timeout, wire.sock, wire.n = e2e.PATIENCE, socket.socket(socket.AF_UNIX), 0
                child = os.fork()
                if not child:
                    become(who)
                    wire.sock.connect(box.daemon.socket)
                    os._exit(0)
                os.waitpid(child, 0)
                wire.sock.settimeout(e2e.PATIENCE)
                tell(wire, "hello", pb.Hello(version_min=1, version_max=1))
                return wire

            def tell(wire, body, value):
                m = pb.Message()
                getattr(m, body).CopyFrom(value)
                wire.n += 1
                wire.send(wire.n, m)
                return wire.recv()[1]

            def sees(wire):
                answer = tell(wire, "datasets_request", pb.DatasetsRequest(name="d"))
                expect(answer.error.code in ("", "not-permitted"), "%s" % answer)
                return not answer.error.code

            admin, carl, anna = connect("an administrator"), connect("carl"), connect("anna")
            expect((sees(admin), sees(carl), sees(anna)) == (True, False, True), "before")
            # The other group has the rights now; that of one who is connected is what was found when he came.
            box.daemon.reload(served.replace(str(ADMINS), str(OTHERS)))
            expect((sees(admin), sees(carl), sees(anna)) == (True, True, True), "carl's group")
            box.daemon.reload(served.replace("admin-group = %d\n" % ADMINS, ""))
            expect((sees(admin), sees(carl), sees(anna)) == (False, False, True), "no group")
            box.daemon.reload("group = %d\nadmin-group = nobody-has-this\n" % GIS)
            expect((sees(admin), sees(carl), sees(anna)) == (False, False, True), "an error")
            # Only for the group of the dataset; anna is in it.
            box.daemon.reload("group = %d\n" % GIS)
            expect(sees(anna), "anna is served")
            for who, wire in (("admin", admin), ("carl", carl)):
                number, answer = wire.recv()[:2]
                expect(number == 0 and answer.error.code == "not-permitted", "%s is told: %s" % (who, answer))
                try:
                    expect(wire.sock.recv(1) == b"", "%s is connected" % who)
                except ConnectionResetError:
                    pass
            box.good("anna", "ping")
            status, _, err = box.ask("carl", "ping")
            expect(status == 77, "carl: %d %s" % (status, err))
            for wire in (admin, carl, anna):
                wire.sock.close()


def holders_in_the_status():
    """All users see who holds how much memory; only administrators see the numbers and datasets of others."""
    with Folder() as base, Box(base, args=GROUPS) as box:
        fifo = os.path.join(base, "fifo")
        os.mkfifo(fifo)
        os.chmod(fifo, 0o666)
        push = box.start("anna", "push", "secret", fifo, "--input-format", "las")
        with open(fifo, "wb") as f:
            with open(box.survey(20000), "rb") as survey:
                f.write(survey.read(100000))
            f.flush()

            def rows(who):
                deadline = time.monotonic() + e2e.PATIENCE
                while time.monotonic() < deadline:
                    got = [h for h in json.loads(box.good(who, "status", "--json"))["holders"] if h["kind"] == "push"]
                    if got:
                        return got
                    time.sleep(0.02)
                expect(False, "%s sees no push" % who)
            for who in ("anna", "an administrator", "root"):
                expect([(h["uid"], h["dataset"]) for h in rows(who)] == [(ANNA, "secret")] and rows(who)[0]["id"], "%s" % rows(who))
            for who in ("carl", "bert, in the group by his first one"):
                got = rows(who)
                expect([(h["uid"], h["dataset"], h["id"]) for h in got] == [(ANNA, None, None)], "%s sees %s" % (who, got))
                expect("secret" not in box.good(who, "status") + box.good(who, "metrics"), "%s sees the name" % who)
            push.terminate()
        push.communicate(timeout=e2e.PATIENCE)


def state_is_private():
    """State and cache are private, whatever the mode of their folder, the umask, and the earlier mode of the catalogue."""
    with e2e.Folder() as base:
        box = Box(base)
        for folder in (box.daemon.state, box.daemon.cache):
            os.mkdir(folder)
            os.chmod(folder, 0o755)
        with box:
            box.daemon.ctl("push", "s", box.survey()).ok()
            box.daemon.ctl("submit", "s", "--wait").ok()
            for folder in (box.daemon.state, box.daemon.cache):
                names = os.listdir(folder)
                expect(names, folder)
                for name in names:
                    mode = os.stat(os.path.join(folder, name)).st_mode
                    expect(not mode & 0o077, "%s/%s has mode %o" % (folder, name, mode))
            # As an earlier acutd made it, or a copy of a backup has it; the journal of one that was killed, too.
            box.daemon.stop(signal.SIGKILL)
            catalogue = os.path.join(box.daemon.state, "catalogue.db")
            files = [catalogue + end for end in ("", "-wal", "-shm") if os.path.exists(catalogue + end)]
            expect(len(files) > 1, str(files))
            for path in files:
                os.chmod(path, 0o644)
            box.daemon.start()
            expect(len(box.daemon.ctl("jobs", "--json").ok().out.splitlines()) == 1, "jobs")
            for path in filter(os.path.exists, files):
                expect(os.stat(path).st_mode & 0o777 == 0o600, "%s has mode %o" % (path, os.stat(path).st_mode))


def main_as_root(*cases):
    """Runs the cases, or skips all if this process cannot become other users."""
    if os.geteuid() != 0:
        print("only root can become other users")
        sys.exit(1 if os.environ.get("ACUT_TEST_PRIVILEGED") == "1" else 77)
    if not shutil.which("setpriv"):
        print("setpriv (util-linux) is needed")
        sys.exit(1 if os.environ.get("ACUT_TEST_PRIVILEGED") == "1" else 77)
    e2e.main(*cases)


if __name__ == "__main__":
    main_as_root(datasets, owners, jobs, served, many_groups, peer_of_the_socket, rights_of_open_connections, holders_in_the_status,
             state_is_private)
