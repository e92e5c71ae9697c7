"""Shared resources, of which no user may take all: room for areas of jobs, datasets, disk space by pushes into datasets of
others, geoid grids, requests for the status. And paths of source files, which only the owner sees, also in an export."""
import json
import os
import shutil
import socket
import subprocess
import sys
import time

import config
import e2e
import geo
from e2e import Folder, expect
from rights import ADMINS, ANNA, BERT, CARL, GIS, GROUPS, OTHERS, USERS, WHO, Box

try:
    from acut_wire import HEADER, Client, Refused, pack, pb
except ImportError as e:
    Client, missing = None, e

GROUP_ONE = "bert, in the group by his first one"
DORA = (3010, OTHERS, (USERS, GIS))
VIEWS = 4 << 20


def as_user(who, do):
    """Runs do() as that user in a process of its own; returns its result, by way of JSON."""
    uid, gid, groups = WHO[who] if isinstance(who, str) else who
    read, write = os.pipe()
    child = os.fork()
    if not child:
        code = 1
        try:
            os.setgroups(groups)
            os.setgid(gid)
            os.setuid(uid)
            os.write(write, json.dumps(do()).encode())
            code = 0
        except BaseException as e:
            sys.stderr.write("     %r\n" % e)
        finally:
            os._exit(code)
    os.close(write)
    with os.fdopen(read) as f:
        text = f.read()
    expect(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, "%s failed" % (who,))
    return json.loads(text)


class Held:
    """A process of that user that keeps what begin() returns until the end of the block; `said` is its length."""

    def __init__(self, who, begin):
        self.who, self.begin = WHO[who] if isinstance(who, str) else who, begin

    def __enter__(self):
        read, write = os.pipe()
        until, self.end = os.pipe()
        self.child = os.fork()
        if not self.child:
            os.close(self.end)
            try:
                os.setgroups(self.who[2])
                os.setgid(self.who[1])
                os.setuid(self.who[0])
                kept = self.begin()
                os.write(write, b"%d" % len(kept))
                os.read(until, 1)
            except BaseException as e:
                sys.stderr.write("     %r\n" % e)
            finally:
                os._exit(0)
        os.close(write)
        os.close(until)
        with os.fdopen(read) as f:
            got = os.read(f.fileno(), 16)
        expect(got, "the crowd failed")
        self.said = int(got)
        return self

    def __exit__(self, *exc):
        os.close(self.end)
        os.waitpid(self.child, 0)


def comb(teeth, down, step=990.0):
    """A polygon with that many teeth, as WKT; a view takes about 9 characters for each."""
    at = [(i * step, step * (i % 2)) for i in range(teeth)]
    ring = at + [(at[-1][0], -2 * step - down), (at[0][0], -2 * step - down), at[0]]
    return "POLYGON((%s))" % ", ".join("%.2f %.2f" % p for p in ring)


def areas_of_jobs():
    """A user whose jobs with large areas take all the room cannot keep others from submitting: that user's oldest jobs are
    removed, those of others stay."""
    if not Client:
        print("     skipped: %s" % missing)
        return
    with Folder() as base, Box(base, args=GROUPS) as box:
        box.good("anna", "push", "--mode", "644", "d", box.survey())
        mine = box.good("anna", "submit", "d", "--wait").split()[0]
        area = os.path.join(base, "area.wkt")
        with open(area, "w") as f:
            f.write(comb(4500, 0))
        os.chmod(area, 0o644)
        box.good("carl", "submit", "d", "--crop", area, "--wait")

        def fill():
            with Client(box.daemon.socket) as c:
                view = c.ask("jobs_request", pb.JobsRequest()).jobs[-1].view
                made = []
                for _ in range(VIEWS // len(view) + 10):
                    made.append(c.ask("submit", pb.Submit(dataset="d", view=view, fresh=True)).id)
                    c.wait(made[-1])
                return len(view), made
        size, jobs = as_user("carl", fill)
        expect(size > 30000, "an area of %d bytes" % size)
        kept = {json.loads(line)["job"] for line in box.good("carl", "jobs", "--json").splitlines()}
        print("     %d jobs of %d KiB submitted, %d kept" % (len(jobs), size >> 10, len(kept)))
        expect(len(kept) < len(jobs) and jobs[-1] in kept and jobs[0] not in kept, "%d of %d are kept" % (len(kept), len(jobs)))
        # Anna needs as much as one of his, and gets it from him.
        with open(area, "w") as f:
            f.write(comb(4500, 5000))
        for i in range(3):
            box.good("anna", "submit", "d", "--crop", area, "--new", "--wait")
        left = {json.loads(line)["job"] for line in box.good("carl", "jobs", "--json").splitlines()}
        expect(len(kept) - 4 <= len(left) < len(kept) and left < kept and min(left) > min(kept), "%d of %d left" % (len(left), len(kept)))
        box.good("anna", "show", mine)


def datasets():
    """A number of datasets for each user, however they are made; removed ones count; administrators have no limit."""
    with Folder() as base, Box(base, args=GROUPS + ("--user-datasets", "3")) as box:
        box.good("anna", "push", "--mode", "666", "a", box.survey())
        box.good("anna", "dataset", "create", "b")
        box.good("root", "dataset", "export", "a", base + "/out")
        subprocess.run(["chmod", "-R", "a+rX", base + "/out"], check=True)
        box.good("anna", "dataset", "import", base + "/out", "c")
        ways = (("push", "e", box.survey()), ("dataset", "create", "e"), ("dataset", "import", base + "/out", "e"))
        for words in ways:
            p = box.start("anna", *words)
            err = p.communicate(timeout=e2e.PATIENCE)[1].decode()
            expect(p.returncode == 1 and "user-datasets" in err and "3" in err, "%s: %d %s" % (words, p.returncode, err))
            expect("uid %d, pid %d" % (ANNA, p.pid) in box.log(), "log: %s" % box.log())
        box.good("anna", "push", "b", box.survey())  # into what is there
        box.good("anna", "dataset", "rm", "c")
        status, _, err = box.ask("anna", "dataset", "create", "e")
        expect(status == 1 and "1 of them removed" in err, "%d %s" % (status, err))
        checks = {c["name"]: c for c in json.loads(box.good("anna", "doctor", "--json"))["checks"]}
        expect(checks["limits"]["state"] == "warning" and "3 of 3 datasets" in checks["limits"]["message"], "%s" % checks["limits"])
        for i, words in enumerate(ways):
            box.good("carl", *(words[:-1] + ("f%d" % i,) if words[-1] == "e" else ("push", "f%d" % i, box.survey())))
        for i in range(5):
            box.good("an administrator", "dataset", "create", "g%d" % i)
        checks = {c["name"]: c for c in json.loads(box.good("root", "doctor", "--json"))["checks"]}
        expect(checks["limits"]["state"] == "ok" and "administrator" in checks["limits"]["message"], "%s" % checks["limits"])
        expect(checks["tasks"]["state"] == "ok" and "threads" in checks["tasks"]["message"], "%s" % checks["tasks"])


def disk_of_groups():
    """A push into the dataset of another user is charged to the pusher until the commit, and then to the owner, who must have
    room for it."""
    with Folder() as base, Box(base, args=GROUPS + ("--user-disk", "1M")) as box:
        small, large = box.survey(), box.survey(20000)
        box.good("anna", "push", "--mode", "660", "shared", small)
        box.good(GROUP_ONE, "push", "own", large)
        status, _, err = box.ask(GROUP_ONE, "push", "shared", box.survey(20000, seed=2))
        expect(status == 1 and "user-disk" in err and "id %d" % BERT in err, "bert: %d %s" % (status, err))
        # Dora has nothing, and keeps nothing of it.
        box.good(DORA, "push", "shared", box.survey(20000, seed=2))
        box.good(DORA, "push", "own2", large)
        # Now anna has no room, also for pushes of others.
        other = (3011, OTHERS, (USERS, GIS))
        box.good(other, "push", "shared", box.survey(20000, seed=3))
        status, _, err = box.ask(other, "push", "shared", box.survey(24000, seed=4))
        expect(status == 1 and "user-disk" in err and "id %d" % ANNA in err, "for anna: %d %s" % (status, err))
        checks = {c["name"]: c for c in json.loads(box.good("anna", "doctor", "--json"))["checks"]}
        expect("on the disk" in checks["limits"]["message"], "%s" % checks["limits"])


class Pusher:
    """A process of a user of its own that pushes one file in steps, on request: pusher("plan") and so on. The result is "ok", or
    the code and message of the error."""

    def __init__(self, box, n, path):
        self.path = path
        self.ask, begin, done, self.answers = *os.pipe()[::-1], *os.pipe()[::-1]
        self.child = os.fork()
        if self.child:
            os.close(begin)
            os.close(done)
            return
        os.close(self.ask)
        os.close(self.answers)
        try:
            os.setgroups([USERS])
            os.setgid(OTHERS)
            os.setuid(3100 + n)
            with Client(box.daemon.socket) as c, open(path, "rb") as f:
                while step := os.read(begin, 64).decode():
                    try:
                        self.step(c, step, f.fileno())
                        answer = "ok"
                    except Refused as e:
                        answer = "%s %s" % (e.code, e)
                    os.write(done, answer.encode())
        except BaseException as e:
            sys.stderr.write("     pusher %d: %r\n" % (n, e))
        finally:
            os._exit(0)

    def step(self, c, step, fd):
        if step == "begin":
            self.push = c.ask("push_begin", pb.PushBegin(dataset="shared")).push
            self.known = c.ask("probe", pb.Probe(push=self.push, name="file", path=self.path.encode()), fd).known
        elif step == "plan":
            c.ask("push_plan", pb.PushPlan(push=self.push))
        elif step == "file":
            self.known or c.ask("file", pb.File(push=self.push, name="file"), fd)
        elif step == "commit":
            c.ask("push_commit", pb.PushCommit(push=self.push))
        else:
            c.ask("push_abort", pb.PushAbort(push=self.push))

    def tell(self, step):
        os.write(self.ask, step.encode())

    def answer(self):
        got = os.read(self.answers, 4096).decode()
        expect(got, "a pusher ended")
        return got

    def __call__(self, step):
        self.tell(step)
        return self.answer()

    def end(self):
        os.kill(self.child, 9)
        os.waitpid(self.child, 0)
        os.close(self.ask)
        os.close(self.answers)


def disk_of_many():
    """Eight users push at once into the dataset of a ninth: together never more than the owner's quota, whoever is first. Pushes
    that end early leave no charge; interrupted ones are charged to the pusher."""
    if not Client:
        print("     skipped: %s" % missing)
        return
    with Folder() as base, Box(base, args=GROUPS + ("--user-disk", "1M")) as box:
        box.good("anna", "push", "--mode", "666", "shared", box.survey())
        pushers = [Pusher(box, n, box.survey(20000, seed=2 + n)) for n in range(8)]

        def all_at_once(step, which):
            for p in which:
                p.tell(step)
            got = {p: p.answer() for p in which}
            for p in which:
                expect(got[p] == "ok" or got[p].startswith("does-not-fit") and "id %d" % ANNA in got[p] and "user-disk" in got[p], got[p])
            return [p for p in which if got[p] == "ok"]

        def one_more(which, why):
            """One of them is admitted as soon as another has released its share, and only one."""
            deadline = time.monotonic() + e2e.PATIENCE
            while not (got := all_at_once("plan", which)) and time.monotonic() < deadline:
                time.sleep(0.01)
            expect(len(got) == 1, "%d were admitted for one that was %s" % (len(got), why))
            return got

        def stored():
            return json.loads(box.good("anna", "dataset", "show", "shared", "--json"))["bytes"]
        # Two of them fit in what is left: 20000 points are 403 KiB at most.
        expect(len(all_at_once("begin", pushers)) == 8, "begin")
        first = all_at_once("plan", pushers)
        expect(len(first) == 2, "%d were admitted" % len(first))
        others = [p for p in pushers if p not in first]
        expect(not all_at_once("plan", others), "a third was admitted")
        # One is given up, another goes with its client: there is room for one more, and then for one more.
        expect(first[0]("abort") == "ok", "abort")
        second = one_more(others, "given up")
        first[1].end()
        others = [p for p in others if p not in second]
        third = one_more(others, "cut")
        others = [p for p in others if p not in third]
        # A file that is read stays, as an interrupted push: of who pushed.
        expect(third[0]("file") == "ok", "file")
        third[0].end()
        fourth = one_more(others, "interrupted")
        others = [p for p in others if p not in fourth]
        # The daemon is killed: none of these is left but the interrupted one.
        box.daemon.process.kill()
        box.daemon.process.wait()
        for p in pushers:
            if p not in first[1:] + third:
                p.end()
        box.daemon.start()
        os.chmod(box.daemon.socket, 0o666)
        pushers = [Pusher(box, n, box.survey(20000, seed=2 + n)) for n in range(8)]
        expect(len(all_at_once("begin", pushers)) == 8, "begin")
        again = all_at_once("plan", pushers)
        expect(len(again) == 2, "%d were admitted after a start" % len(again))
        for p in again:
            for step in ("file", "commit"):
                expect(p(step) == "ok", step)
        expect(1 << 19 < stored() <= 1 << 20, "%d bytes" % stored())
        expect(not all_at_once("plan", [p for p in pushers if p not in again]), "admitted into what is full")
        for p in pushers:
            p.end()
        print("     %d bytes of %d are hers" % (stored(), 1 << 20))


def disk_of_geoids():
    with Folder() as base, Box(base, args=GROUPS + ("--user-disk", "1M")) as box:
        one = geo.pgm(base + "/one.pgm", lambda lat, lon: 40.0, width=720, rows=361)
        two = geo.pgm(base + "/two.pgm", lambda lat, lon: 41.0, width=720, rows=361)
        for path in (one, two):
            os.chmod(path, 0o644)
        three = geo.pgm(base + "/three.pgm", lambda lat, lon: 42.0, width=720, rows=361)
        os.chmod(three, 0o644)
        box.good("carl", "geoid", "add", one)
        box.good("carl", "geoid", "add", one, "--name", "twin")  # lies there once
        box.good("carl", "geoid", "add", two)
        status, _, err = box.ask("carl", "geoid", "add", three)
        expect(status == 1 and "user-disk" in err and "id %d" % CARL in err, "a third: %d %s" % (status, err))
        status, _, err = box.ask("carl", "push", "d", box.survey(20000))
        expect(status == 1 and "user-disk" in err, "a push: %d %s" % (status, err))
        box.daemon.stop()
        box.daemon.start()
        os.chmod(box.daemon.socket, 0o666)
        status, _, err = box.ask("carl", "geoid", "add", three)
        expect(status == 1 and "user-disk" in err, "after a start: %d %s" % (status, err))
        box.good("an administrator", "geoid", "add", three)
        box.good("carl", "geoid", "rm", "two")
        box.good("carl", "geoid", "add", two, "--name", "again")
        for name in ("again", "twin", "one"):
            box.good("carl", "geoid", "rm", name)
        box.good("carl", "push", "d", box.survey(20000))


def number_of_geoids():
    """A user may have a quarter of the names that others leave of 64; administrators may add until there are 64."""
    with Folder() as base, Box(base, args=GROUPS) as box:
        grid = geo.pgm(base + "/grid.pgm")
        os.chmod(grid, 0o644)
        n = 0

        def add(who, times):
            nonlocal n
            for _ in range(times):
                n += 1
                box.good(who, "geoid", "add", grid, "--name", "g%d" % n)

        def full(who, says):
            status, _, err = box.ask(who, "geoid", "add", grid, "--name", "more")
            expect(status == 1 and says in err, "%s: %d %s" % (who, status, err))

        add("carl", 16)
        full("carl", "16 geoid grids of this user are kept already")
        add("anna", 12)
        full("anna", "12 geoid grids of this user are kept already")
        add("an administrator", 64 - 28)
        full("an administrator", "64 geoid grids are kept already")
        # One that he takes away makes room for an administrator's, and not for his, now that others have more.
        box.good("carl", "geoid", "rm", "g1")
        full("carl", "15 geoid grids of this user are kept already")
        add("root", 1)


def exports():
    """A user who may read a dataset exports it without the paths of its owner's files; an import of that has the same meshes."""
    with Folder() as base, Box(base, args=GROUPS) as box:
        place = os.path.join(base, "out")
        os.mkdir(place)
        os.chmod(place, 0o777)
        secret = os.path.join(base, "where-anna-keeps-them")
        os.mkdir(secret)
        for i in range(3):
            shutil.copy(box.survey(2000, seed=i + 1), "%s/%d.las" % (secret, i))
        os.chmod(secret, 0o755)
        box.good("anna", "push", "--mode", "664", "d", *("%s/%d.las" % (secret, i) for i in range(3)))
        want = json.loads(box.good("anna", "submit", "d", "--wait", "--json"))["digest"]
        for who, sees in (("anna", True), ("carl", False), ("an administrator", True), (GROUP_ONE, False), ("root", True)):
            to = "%s/%s" % (place, WHO[who][0])
            box.good(who, "dataset", "export", "d", to)
            for again in range(2):
                with open(to + "/manifest", "rb") as f:
                    found = b"where-anna-keeps-them" in f.read()
                expect(found == sees, "%s: the paths are %sthere" % (who, "" if found else "not "))
                box.good(who, "dataset", "export", "d", to)
            subprocess.run(["chmod", "-R", "a+rX", to], check=True)
            box.good("carl", "dataset", "import", to, "copy-%s" % WHO[who][0])
            name = "copy-%s" % WHO[who][0]
            expect(json.loads(box.good("carl", "submit", name, "--wait", "--json"))["digest"] == want, "%s: another mesh" % who)
            files = [f for line in box.good("carl", "dataset", "log", name, "--files", "--json").splitlines()
                     for f in json.loads(line)["files"] or ()]
            expect(sorted(f["name"] for f in files) == ["0.las", "1.las", "2.las"], "%s" % files)
            expect(all(bool(f["path"]) == sees for f in files), "%s" % files)
            # By content they are known, whoever exported them.
            out = box.good("carl", "push", name, "--checksum", *("%s/%d.las" % (secret, i) for i in range(3)))
            expect(json.loads(box.good("carl", "dataset", "show", name, "--json"))["generation"] == 1, out)
        # No refusal says it either: a writer of others reverts what cannot be.
        box.good("anna", "dataset", "chmod", "666", "d")
        box.good("anna", "dataset", "revert", "d")
        box.good("anna", "push", "d", secret + "/0.las")
        status, _, err = box.ask("carl", "dataset", "revert", "d", "2")
        expect(status != 0 and "where-anna" not in err, "carl: %d %s" % (status, err))
        status, _, err = box.ask("anna", "dataset", "revert", "d", "2")
        expect(status != 0 and "where-anna" in err, "anna: %d %s" % (status, err))


def crowds():
    """Many connections of users that do nothing, or send half a message each: others are served all the time."""
    if not Client:
        print("     skipped: %s" % missing)
        return
    hello = pack(1, pb.Message(hello=pb.Hello(version_min=1, version_max=1, program="crowd")))
    halves = {n: pack(2, pb.Message(hello=pb.Hello(version_min=1, version_max=1, program="x" * n)))[:-1] for n in (24000, 1500)}

    def open_all(tries, half):
        kept = []
        for i in range(tries):
            s = socket.socket(socket.AF_UNIX)
            s.settimeout(e2e.PATIENCE)
            try:
                s.connect(box.daemon.socket)
                s.sendall(hello)
                if pb.Message.FromString(s.recv(65536)[HEADER.size:]).WhichOneof("body") == "hello":
                    s.sendall(half(i))
                    kept.append(s)
            except OSError:
                pass
        return kept

    begun = time.monotonic()
    with Folder() as base, Box(base, args=GROUPS, memory="32M") as box:
        box.good("anna", "push", "--mode", "644", "d", box.survey())
        # 256 places there are, and 4 MiB for messages.
        for kind, first, second in (("idle", lambda i: b"", lambda i: b""),
                                    ("half a message", lambda i: halves[24000], lambda i: halves[24000] if i < 150 else halves[1500] if i < 250 else b"")):
            with Held("anna", lambda: open_all(200, first)) as one, Held(GROUP_ONE, lambda: open_all(350, second)) as two:
                expect(kind != "idle" or (one.said, two.said) == (128, 64), "%d of one user and %d of another" % (one.said, two.said))
                for who in ("carl", "root"):
                    box.good(who, "ping")
                    box.good(who, "submit", "d", "--wait")
                box.good("carl", "push", "c", box.survey(seed=2))
        box.good("anna", "ping")
        # Of each kind the log has some, and then their number: no flood of it.
        lines = box.log().splitlines()
        expect("as many as one user may have" in box.log(), "log: %s" % lines[-20:])
        told = [line for line in lines if "cut off" in line]
        box.daemon.stop()
        expect(0 < len(told) <= 22 * (1 + int(time.monotonic() - begun) // 30), "%d lines of those who were cut off" % len(told))
        expect(" more clients were cut off" in box.log(), "log: %s" % lines[-20:])


def reloaded():
    """Each setting that SIGHUP reloads takes effect, and none after it is removed again. For disk and log-level see config.py."""
    if not Client:
        print("     skipped: %s" % missing)
        return
    with Folder() as base, Box(base) as first:
        first.daemon.stop()
        box, always, tried = first, "keep-free = 0%\n", {"disk", "log-level"}
        box.daemon = config.Configured(base, always)
        box.daemon.start()
        os.chmod(box.daemon.socket, 0o666)
        small = box.survey()

        def reload(text=""):
            box.daemon.reload(always.replace("keep-free = 0%\n", "") + text if "keep-free" in text else always + text)
            tried.update(line.split(" = ")[0] for line in text.splitlines())

        def refused(who, status, says, *args):
            got, _, err = box.ask(who, *args)
            expect(got == status and says in err, "%s: %s: %d %s" % (who, args, got, err))

        box.good("anna", "push", "--mode", "644", "d", small)
        # What a refused push has made of "e" goes in the background: the limit of datasets is tried with a name of its own.
        for text, status, says, args in (("keep-free = 1000T\n", 74, "keep-free", ("push", "e", small)),
                                         ("user-memory = 1%\n", 1, "user-memory", ("push", "e", small)),
                                         ("user-disk = 1K\n", 1, "user-disk", ("push", "e", small)),
                                         ("user-datasets = 1\n", 1, "user-datasets", ("push", "f", small)),
                                         ("group = %d\n" % GIS, 77, "members of the group", ("ping",))):
            reload(text)
            refused("carl" if "group" in text else "anna", status, says, *args)
            reload()
        box.good("carl", "ping")
        box.good("anna", "push", "e", small)
        refused("an administrator", 77, "", "dataset", "rm", "e")
        reload("admin-group = %d\n" % ADMINS)
        box.good("an administrator", "dataset", "rm", "e")
        reload()
        refused("an administrator", 77, "", "dataset", "rm", "d")

        # Removed datasets are deleted.
        def removed():
            return " 1\n" in next(line + "\n" for line in box.good("root", "metrics").splitlines() if line.startswith("acut_datasets_removed "))
        expect(removed(), "e is gone already")
        time.sleep(1)  # for which it is to be kept
        reload("keep-removed = 1s\n")
        deadline = time.monotonic() + e2e.PATIENCE
        while removed() and time.monotonic() < deadline:
            time.sleep(0.05)
        expect(not removed(), "e is still there")

        # A job that lacks space waits, and its user has one that is not done; what a client waits for does for so long.
        reload("keep-free = 1000T\nspace-wait = 1h\nuser-jobs = 1\n")
        job = box.good("anna", "submit", "d", "--every", "3").split()[0]
        refused("anna", 1, "user-jobs", "submit", "d", "--new", "--every", "2")
        with Client(box.daemon.socket) as c:
            view = json.loads(box.good("anna", "show", job, "--json"))["view"]
            bound = c.ask("submit", pb.Submit(dataset="d", view=view, fresh=True, bound=True)).id
            reload("keep-free = 1000T\nspace-wait = 0s\n")
            end = c.wait(bound)
            expect(end.state == "failed" and end.error.code == "no-space", "%s" % end)
        box.good("anna", "cancel", job)
        reload()

        def one():
            kept = Client(box.daemon.socket)
            kept.ping()
            return [kept]
        with Held("anna", one):
            box.good("anna", "ping")
            reload("user-connections = 1\n")
            refused("anna", 75, "user-connections", "ping")
        told = {n for n, s in box.daemon.settings().items() if s["reload"]}
        expect(tried == told, "not tried, or not said: %s" % sorted(tried ^ told))


def swallow(send, data):
    try:
        send(data)
    except OSError:
        pass


def turned_away():
    """An administrator, who has no limits, fills the memory for messages with half messages, ever shorter ones, and keeps
    connecting: new clients are refused, each with an answer; the log has some of them and then their number."""
    if not Client:
        print("     skipped: %s" % missing)
        return
    halves = {n: pack(2, pb.Message(hello=pb.Hello(version_min=1, version_max=1, program="x" * n)))[:-1] for n in (24000, 1500, 1)}
    hello = pack(1, pb.Message(hello=pb.Hello(version_min=1, version_max=1, program="crowd")))
    kept, away, begun = [], 0, time.monotonic()
    with Folder() as base, Box(base, memory="32M") as box:
        while away < 300 and (i := away + len(kept)) < 3000:
            s = socket.socket(socket.AF_UNIX)
            s.settimeout(e2e.PATIENCE)
            s.connect(box.daemon.socket)
            swallow(s.sendall, hello)
            got = pb.Message.FromString(s.recv(65536)[HEADER.size:])
            if got.WhichOneof("body") == "error" and "memory left for a c" in got.error.message:
                expect(got.error.code == "busy", "%s" % got)
                away += 1
                s.close()
                continue
            swallow(s.sendall, halves[24000 if i < 200 else 1500 if i < 400 else 1])
            kept.append(s)
        expect(away == 300, "%d were turned away, %d were not" % (away, len(kept)))
        for s in kept:
            s.close()
        box.daemon.stop()
        lines = [line for line in box.log().splitlines() if "turned away" in line]
        whiles = 1 + int(time.monotonic() - begun) // 30
        expect(20 <= len(lines) <= 22 * whiles and any(" more clients were turned away within" in line for line in lines), "%d lines: %s" %
               (len(lines), lines[-3:]))
        hidden = sum(int(line.split(" more clients")[0].split()[-1]) for line in lines if " more clients" in line)
        expect(hidden + sum(" more clients" not in line for line in lines) == away, "%d lines for %d" % (len(lines), away))


if __name__ == "__main__":
    if os.geteuid() != 0:
        print("to be several users takes root")
        sys.exit(1 if os.environ.get("ACUT_TEST_PRIVILEGED") == "1" else 77)
    if not shutil.which("setpriv"):
        print("setpriv (util-linux) is needed")
        sys.exit(1 if os.environ.get("ACUT_TEST_PRIVILEGED") == "1" else 77)
    e2e.main(areas_of_jobs, datasets, disk_of_groups, disk_of_many, disk_of_geoids, number_of_geoids, exports, crowds, turned_away, reloaded)
